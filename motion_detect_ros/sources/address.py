"""Telling cameras and network addresses from files."""

from __future__ import annotations


def is_address(source: str) -> bool:
    """True for a camera number or a network address, False for a path."""
    return source.isdigit() or '://' in source
