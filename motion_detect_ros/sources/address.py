"""Telling cameras and network addresses from files."""

from __future__ import annotations

from pathlib import Path

_FILE = 'file://'
_DIGITS = 9


def is_address(source: str) -> bool:
    """True for a camera number or a network address, False for a path, also one that begins with ``file://``."""
    return camera_number(source) is not None or ('://' in source and not source.startswith(_FILE))


def camera_number(source: str) -> int | None:
    """The number of a camera; None for what is none."""
    return int(source) if source.isdecimal() and len(source) <= _DIGITS else None


def path_of(source: str) -> Path:
    """The path of a source that is no address."""
    return Path(source.removeprefix(_FILE))
