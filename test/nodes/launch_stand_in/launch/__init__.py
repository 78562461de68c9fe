"""As much of ``launch`` as the launch files use: it evaluates arguments and starts nothing."""

from __future__ import annotations

from collections.abc import Sequence
from types import SimpleNamespace
from typing import Any


class LaunchContext:
    """What arguments were given."""

    def __init__(self) -> None:
        self.launch_configurations: dict[str, str] = {}
        self.is_shutdown = False


class LaunchDescription(SimpleNamespace):
    """A list of actions."""

    def __init__(self, actions: Sequence[Any]) -> None:
        super().__init__(visit=lambda _context: list(actions))
