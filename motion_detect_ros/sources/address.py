"""Telling cameras and network addresses from files."""

from __future__ import annotations

import os
import re
from pathlib import Path

_FILE = 'file://'
_DIGITS = 9
#: As Linux names cameras.
_DEVICE = re.compile(rf'/dev/video(\d{{1,{_DIGITS}}})')


def is_address(source: str) -> bool:
    """True for a camera (its number, or its device as /dev/video0) or a network address, False for any other path, also
    one that begins with ``file://``.
    """
    return camera_number(source) is not None or ('://' in source and not source.startswith(_FILE))


def camera_number(source: str) -> int | None:
    """The number of a camera, given as such, as its device or as a link to that; None for what is none."""
    if source.isdecimal() and len(source) <= _DIGITS:
        return int(source)
    device = _DEVICE.fullmatch(os.path.realpath(path_of(source)))
    return int(device[1]) if device else None


def path_of(source: str) -> Path:
    """The path of a source that is no address."""
    return Path(source.removeprefix(_FILE))
