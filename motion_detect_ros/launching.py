"""What the launch files share: arguments read as users write them and refused in one line, and how a launch ends."""

from __future__ import annotations

import re
import subprocess
from collections.abc import Callable, Iterable, Mapping
from typing import Any

from motion_detect_ros.core.errors import ConfigError, MotionDetectError, SourceError
from motion_detect_ros.presets import preset_path
from motion_detect_ros.sources.address import path_of

#: An argument of a launch file: name, default (None = needed), what it means. An empty text is an argument not given.
Argument = tuple[str, str | None, str]
#: Argument ``mode`` -> the nodes that do the work.
STAGES = {'nodes': ('ego_motion', 'optical_flow', 'art2_clustering'), 'pipeline': ('pipeline',)}
#: Arguments with few values.
CHOICES = {'mode': list(STAGES), 'image_reliability': ['', 'auto', 'reliable', 'best_effort'],
           'image_transport': ['', 'raw', 'compressed']}
#: What Nav2's users, launch's own conditions and YAML write, in lower case.
_FLAGS = {'true': True, 'yes': True, 'on': True, '1': True, 'false': False, 'no': False, 'off': False, '0': False}
#: What rcl knows, in any case; ``logger:=level`` sets one logger.
_LOG_LEVELS = ('debug', 'info', 'warn', 'error', 'fatal')
_NAME = '[A-Za-z_][A-Za-z0-9_]*'


def declared(arguments: Iterable[Argument]) -> list[Any]:
    """The actions that declare arguments; launch itself refuses a missing one, and one that is none of the choices."""
    from launch.actions import DeclareLaunchArgument  # launch is not there where nothing is launched
    return [DeclareLaunchArgument(name, default_value=default, description=meaning, choices=CHOICES.get(name))
            for name, default, meaning in arguments]


def given(context: Any, arguments: Iterable[Argument]) -> dict[str, str]:
    """The values of declared arguments. context: launch's ``LaunchContext``."""
    return {name: context.launch_configurations[name] for name, _, _ in arguments}


def told(context: Any, without_effect: Mapping[str, str]) -> list[Any]:
    """Actions that say which arguments do nothing here.

    without_effect: undeclared argument -> the one value of it that is right. They are no errors: a larger launch may
    have arguments of the same names, which reach every file that it includes.
    """
    from launch.actions import LogInfo
    values = {name: context.launch_configurations.get(name, '') for name in without_effect}
    return [LogInfo(msg=f'launch argument {name}: {value!r} has no effect here') for name, value in values.items()
            if value.lower() not in ('', without_effect[name])]


def flag(name: str, text: str) -> bool:
    """A launch argument that is true or false, in any case. Raises: ConfigError for any other word."""
    try:
        return _FLAGS[text.strip().lower()]
    except KeyError:
        raise ConfigError(f'launch argument {name}: expected true or false, got {text!r}') from None


def number(name: str, text: str) -> float:
    """A launch argument that is a number. Raises: ConfigError for anything else."""
    try:
        return float(text)
    except ValueError:
        raise ConfigError(f'launch argument {name}: expected a number, got {text!r}') from None


def word(_name: str, text: str) -> Any:
    """A parameter that stays a text, whatever it looks like."""
    from launch_ros.parameter_descriptions import ParameterValue
    return ParameterValue(text, value_type=str)


def parameter_file(text: str) -> str:
    """The file of argument ``params_file``, a preset or a path. Raises: ConfigError where there is none."""
    try:
        return str(preset_path(text))
    except ConfigError as error:
        raise ConfigError(f'launch argument params_file: {error}') from None


def log_level(text: str) -> str:
    """The argument ``log_level``. Raises: ConfigError for what no node takes."""
    if text.rpartition(':=')[2].lower() not in _LOG_LEVELS:
        raise ConfigError(f'launch argument log_level: expected one of {", ".join(_LOG_LEVELS)}, got {text!r}')
    return text


def namespace(name: str, text: str) -> str:
    """A launch argument that is a namespace, without a slash at its end. Raises: ConfigError for what ROS refuses."""
    if not re.fullmatch(rf'/?|/?{_NAME}(/{_NAME})*/?', text):
        raise ConfigError(f'launch argument {name}: expected a namespace such as front or /robot1/front, got {text!r}')
    return text.rstrip('/')


def cores(text: str) -> str | None:
    """The command that keeps a process on the cores of argument ``cpus``; None for all.

    Raises: ConfigError where there are none of these, or no taskset.
    """
    if not text.strip():
        return None
    command = ['taskset', '--cpu-list', ''.join(text.split())]
    try:
        done = subprocess.run([*command, 'true'], capture_output=True, text=True, check=False)
    except OSError as error:
        raise ConfigError(f'launch argument cpus: expected the program taskset, got {error}') from None
    if done.returncode:
        raise ConfigError(f'launch argument cpus: expected cores of this machine, as 0,1 or 0-3, got {text!r}')
    return ' '.join(command)


def existing(name: str, text: str) -> str:
    """A launch argument that names a file or folder. Raises: SourceError where there is none."""
    if not text or not path_of(text).exists():
        raise SourceError(f'launch argument {name}: expected a file or folder, got {text!r}')
    return text


def pairs(name: str, words: str) -> list[tuple[str, str]]:
    """A launch argument of the form ``front=0 rear=1``. Raises: ConfigError for another form, or a name twice."""
    found = [(word.partition('=')[0], word.partition('=')[2]) for word in words.split()]
    if not found or not all(key and value for key, value in found) or len(dict(found)) < len(found):
        raise ConfigError(f'launch argument {name}: expected "front=0 rear=1", each name once, got {words!r}')
    return found


def fail_with(event: Any, context: Any) -> list[Any]:
    """An ``on_exit`` of launch: the launch goes on without the process. event: launch's ``ProcessExited``.

    Raises: MotionDetectError where the process failed: launch then ends all others, and its own exit code is 1.
    """
    if event.returncode and not context.is_shutdown:
        raise MotionDetectError(f'{event.process_name} failed with exit code {event.returncode}')
    return []


def end_with(processes: int = 1) -> Callable[[Any, Any], list[Any]]:
    """An ``on_exit`` for so many processes: the launch ends well with the last, and fails where one fails."""
    left = processes

    def on_exit(event: Any, context: Any) -> list[Any]:
        from launch.actions import Shutdown
        nonlocal left
        left -= 1
        if fail_with(event, context) or left > 0 or context.is_shutdown:
            return []
        return [Shutdown(reason=f'{event.process_name} is done')]
    return on_exit
