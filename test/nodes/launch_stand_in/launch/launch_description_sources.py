"""Where included launch files come from."""

from __future__ import annotations

import runpy
from typing import Any


class PythonLaunchDescriptionSource:
    """A file of Python."""

    def __init__(self, path: str) -> None:
        self._path = path

    def description(self) -> Any:
        return runpy.run_path(self._path)['generate_launch_description']()
