"""Nodes."""

from __future__ import annotations

from typing import Any


class Node:
    """Takes what the real one takes."""

    def __init__(self, *, executable: str, package: str, **_options: Any) -> None:
        self.node_package, self.node_executable = package, executable
