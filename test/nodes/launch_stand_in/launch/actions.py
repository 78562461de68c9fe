"""Actions; ``visit`` gives the actions that follow from one."""

from __future__ import annotations

from collections.abc import Callable
from types import SimpleNamespace
from typing import Any

from launch import LaunchContext


class DeclareLaunchArgument:
    """Fails as launch does: where a value is missing, or none of the choices."""

    def __init__(self, name: str, *, default_value: str | None = None, description: str,
                 choices: list[str] | None = None) -> None:
        self._name, self._default, self._choices = name, default_value, choices
        self.description = description

    def visit(self, context: LaunchContext) -> None:
        given = context.launch_configurations
        if self._name not in given:
            if self._default is None:
                raise RuntimeError(f'Required launch argument "{self._name}" was not provided.')
            given[self._name] = self._default
        if self._choices is not None and given[self._name] not in self._choices:
            raise RuntimeError(f'Argument "{self._name}" provided value "{given[self._name]}" is not valid. '
                               f'Valid options are: {self._choices}')


class OpaqueFunction(SimpleNamespace):
    """A function of the context that returns actions."""

    def __init__(self, *, function: Callable[[LaunchContext], list[Any]]) -> None:
        super().__init__(visit=function)


class LogInfo:
    """A line on the console."""

    def __init__(self, *, msg: str) -> None:
        self.msg = msg

    def visit(self, _context: LaunchContext) -> None:
        pass


class Shutdown(SimpleNamespace):
    """Ends the launch."""
