"""What the program of a node takes on its command line: ROS arguments, and nothing beside them."""

from __future__ import annotations

import json
import re
import shlex
from collections.abc import Sequence
from pathlib import Path

from rclpy.impl.implementation_singleton import rclpy_implementation
from rclpy.utilities import remove_ros_args

from motion_detect_ros.core.errors import ConfigError
from motion_detect_ros.presets import find_config

HELP = frozenset({'-h', '--help'})
BEGIN, END, FILE, RULE = '--ros-args', '--', '--params-file', ':='
#: What rcl adds that tells a user nothing: where in its own source it found fault, and that it does not know which.
_NOISE = re.compile(r', at \S+:\d+|\. Error: error not set')


def usage(words: Sequence[str]) -> str:
    """What ``--help`` prints, empty where nobody asks for it. words: the program and its arguments."""
    if HELP.isdisjoint(words[1:]):
        return ''
    return (f'usage: {_name(words)} [{BEGIN} [-p NAME:=VALUE] [-r FROM:=TO] [{FILE} FILE] ...]\n'
            'Parameters and topics: docs/nodes.md of the package; those of an example: its first lines.')


def check_arguments(words: Sequence[str]) -> None:
    """words: the program and its arguments.

    Raises: ConfigError, one line, for what ROS leaves over or does not understand, and for missing parameter files.
    """
    of_ros = _of_ros(words)
    read_once = set[int]()
    for index in range(1, len(words) - 1):
        if words[index] == FILE and of_ros[index] and not _is_regular(words[index + 1]):
            read_once |= {index, index + 1}
    given = [word for word, taken in zip(words, of_ros, strict=True) if not taken]
    parsed = [word for index, word in enumerate(words) if index not in read_once]
    if any(RULE not in word for word in given) or _left_over(parsed):  # a bare rule is taken by ROS, with a warning
        raise ConfigError(f'{_name(words)}: expected {BEGIN} before all arguments, got {shlex.join(given)}; '
                          '--help shows how')


def text_parameter(name: str, text: str) -> str:
    """What to give behind ``-p``, so that the value is this text: ROS reads it as YAML, to which a path may be a
    number, end at a ``#``, or be no text at all.
    """
    quoted = json.dumps(text, ensure_ascii=False)
    return f'{name}{RULE}' + ''.join(each if each.isprintable() else f'\\U{ord(each):08x}' for each in quoted)


def _name(words: Sequence[str]) -> str:
    return Path(words[0]).stem


def _of_ros(words: Sequence[str]) -> list[bool]:
    """Of each word whether it is the program or stands between ``--ros-args`` and ``--``, these included."""
    found, inside = [True], False
    for word in words[1:]:
        found.append(inside or word == BEGIN)
        inside = word == BEGIN or (inside and word != END)
    return found


def _is_regular(name: str) -> bool:
    """Whether a parameter file may be read here too: a pipe may not. Raises: ConfigError where there is no file."""
    path = Path(name)
    if not path.exists() or path.is_dir():
        raise ConfigError(
            f'{FILE}: expected a file, got {name}, which is none; names of presets work in launch files and offline '
            f'commands only, the files of the presets are in {find_config("default.yaml").parent}')
    return path.is_file()


def _left_over(words: Sequence[str]) -> list[str]:
    """What rcl does not take. Raises: ConfigError with its own words where it understands something wrong."""
    try:
        return list(remove_ros_args(words)[1:])
    except rclpy_implementation.UnknownROSArgsError as error:
        unknown = str(error).strip('[]')
        raise ConfigError(f'{_name(words)}: expected ROS arguments after {BEGIN}, got {unknown}') from None
    except RuntimeError as error:
        raise ConfigError(_NOISE.sub('', str(error))) from None
