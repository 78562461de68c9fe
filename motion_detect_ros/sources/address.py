"""Telling cameras and network addresses from files."""

from __future__ import annotations

from pathlib import Path

_FILE = 'file://'


def is_address(source: str) -> bool:
    """True for a camera number or a network address, False for a path, also one that begins with ``file://``."""
    return source.isdigit() or ('://' in source and not source.startswith(_FILE))


def path_of(source: str) -> Path:
    """The path of a source that is no address."""
    return Path(source.removeprefix(_FILE))
