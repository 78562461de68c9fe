"""Values that are known when the launch runs."""

from __future__ import annotations

from launch import LaunchContext


class LaunchConfiguration:
    """The value of an argument."""

    def __init__(self, name: str) -> None:
        self._name = name

    def perform(self, context: LaunchContext) -> str:
        return context.launch_configurations[self._name]
