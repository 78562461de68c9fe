"""Many pictures on one: a grid of captioned thumbnails."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import cv2
import numpy as np

from motion_detect_ros.core.errors import FrameError
from motion_detect_ros.core.types import ByteArray

COLUMNS, TILE_WIDTH_PX = 3, 480
#: Strip under each picture that holds its caption, and the space around the pictures, pixels.
CAPTION_PX, GAP_PX = 22, 6
BACKGROUND_BGR, INK_BGR = (32, 32, 32), (235, 235, 235)
_FONT, _FONT_SCALE, _BASELINE_PX = cv2.FONT_HERSHEY_SIMPLEX, 0.45, 7


@dataclass(frozen=True)
class Tile:
    """One picture, (H, W, 3) uint8 BGR, and the line under it (ASCII)."""

    image: ByteArray
    caption: str


def contact_sheet(tiles: Sequence[Tile], columns: int = COLUMNS, tile_width_px: int = TILE_WIDTH_PX) -> ByteArray:
    """The tiles row by row, each shrunk to ``tile_width_px`` with its aspect kept; (H, W, 3) uint8 BGR.

    Raises: FrameError where there is none, or where one has another shape than the others.
    """
    if not tiles:
        raise FrameError('contact sheet: expected at least one picture, got none')
    shapes = {tile.image.shape for tile in tiles}
    if len(shapes) > 1 or tiles[0].image.ndim != 3:
        raise FrameError(f'contact sheet: expected BGR pictures of one shape, got {sorted(shapes)}')
    columns = min(columns, len(tiles))
    cells = [_cell(tile, tile_width_px) for tile in tiles]
    cells += [np.full_like(cells[0], BACKGROUND_BGR)] * (-len(cells) % columns)
    sheet = cv2.vconcat([cv2.hconcat(cells[row:row + columns]) for row in range(0, len(cells), columns)])
    return cv2.copyMakeBorder(sheet, GAP_PX, 0, GAP_PX, 0, cv2.BORDER_CONSTANT, value=BACKGROUND_BGR)


def _cell(tile: Tile, width_px: int) -> ByteArray:
    """The thumbnail with its caption under it and the gap to its right and bottom."""
    height, width = tile.image.shape[:2]
    height_px = max(1, round(width_px * height / width))
    small = cv2.resize(tile.image, (width_px, height_px), interpolation=cv2.INTER_AREA)
    cell = cv2.copyMakeBorder(
        small, 0, CAPTION_PX + GAP_PX, 0, GAP_PX, cv2.BORDER_CONSTANT, value=BACKGROUND_BGR)
    return cv2.putText(cell, tile.caption, (0, height_px + CAPTION_PX - _BASELINE_PX), _FONT, _FONT_SCALE, INK_BGR, 1,
                       cv2.LINE_AA)


def spread_over(count: int, wanted: int) -> list[int]:
    """At most ``wanted`` indices of ``count`` pictures, evenly spaced, the first picture left out where it can be."""
    step = max(1, count // max(wanted, 1))
    return list(range(count - 1, -1, -step))[:wanted][::-1]
