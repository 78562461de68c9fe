"""What the launch files share: arguments read as users write them and refused in one line, and how a launch ends."""

from __future__ import annotations

from typing import Any

from motion_detect_ros.core.errors import ConfigError, SourceError
from motion_detect_ros.presets import preset_path
from motion_detect_ros.sources.address import path_of

#: Argument ``mode`` -> the nodes that do the work.
STAGES = {'nodes': ('ego_motion', 'optical_flow', 'art2_clustering'), 'pipeline': ('pipeline',)}
#: What Nav2's users, launch's own conditions and YAML write, in lower case.
_FLAGS = {'true': True, 'yes': True, 'on': True, '1': True, 'false': False, 'no': False, 'off': False, '0': False}


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


def parameter_file(text: str) -> str:
    """The file of argument ``params_file``, a preset or a path. Raises: ConfigError where there is none."""
    try:
        return str(preset_path(text))
    except ConfigError as error:
        raise ConfigError(f'launch argument params_file: {error}') from None


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


def text(value: str) -> Any:
    """A parameter that stays a text, whatever it looks like."""
    from launch_ros.parameter_descriptions import ParameterValue  # launch is not there where nothing is launched
    return ParameterValue(value, value_type=str)


def end_with(event: Any, context: Any) -> list[Any]:
    """An ``on_exit`` of launch: the launch ends with the process. event: launch's ``ProcessExited``.

    Raises: SourceError where the process failed, which fails the launch.
    """
    from launch.actions import Shutdown
    if context.is_shutdown:
        return []
    if event.returncode:
        raise SourceError(f'{event.process_name} failed with exit code {event.returncode}')
    return [Shutdown(reason=f'{event.process_name} is done')]
