"""Ignored rectangles of the image, parsed from the text of a setting."""

from __future__ import annotations

from typing import NamedTuple

from motion_detect_ros.core.errors import ConfigError


class Region(NamedTuple):
    """A rectangle of the full-resolution image: left, top, width and height, pixels."""

    x: int
    y: int
    width: int
    height: int


def parse_regions(text: str) -> tuple[Region, ...]:
    """'x,y,w,h; x,y,w,h' as regions; '' as none. Raises: ConfigError for anything else."""
    return tuple(_parse_region(part) for part in text.split(';') if part.strip())


def _parse_region(text: str) -> Region:
    try:
        region = Region(*(int(number) for number in text.split(',')))
    except (TypeError, ValueError):
        raise ConfigError(f'preprocessing.ignore_regions: expected "x,y,w,h; x,y,w,h", whole pixels, '
                          f'got {text.strip()!r}') from None
    if min(region.x, region.y) < 0 or min(region.width, region.height) < 1:
        raise ConfigError(f'preprocessing.ignore_regions: expected x, y from 0 and w, h from 1, got {text.strip()!r}')
    return region
