"""Many pictures on one: a grid of captioned thumbnails."""

from __future__ import annotations

import math
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

    All tiles have the height of the first. Raises: FrameError where there is none, or where one has another shape.
    """
    if not tiles:
        raise FrameError('contact sheet: expected at least one picture, got none')
    shapes = {tile.image.shape for tile in tiles}
    if len(shapes) > 1 or tiles[0].image.ndim != 3:
        raise FrameError(f'contact sheet: expected BGR pictures of one shape, got {sorted(shapes)}')
    height, width = tiles[0].image.shape[:2]
    tile_height_px = max(1, round(tile_width_px * height / width))
    columns = min(columns, len(tiles))
    rows = math.ceil(len(tiles) / columns)
    pitch_x, pitch_y = tile_width_px + GAP_PX, tile_height_px + CAPTION_PX + GAP_PX
    sheet = np.full((rows * pitch_y + GAP_PX, columns * pitch_x + GAP_PX, 3), BACKGROUND_BGR, np.uint8)
    for index, tile in enumerate(tiles):
        left, top = GAP_PX + index % columns * pitch_x, GAP_PX + index // columns * pitch_y
        picture = cv2.resize(tile.image, (tile_width_px, tile_height_px), interpolation=cv2.INTER_AREA)
        sheet[top:top + tile_height_px, left:left + tile_width_px] = picture
        caption_at = left, top + tile_height_px + CAPTION_PX - _BASELINE_PX
        cv2.putText(sheet, tile.caption, caption_at, _FONT, _FONT_SCALE, INK_BGR, 1, cv2.LINE_AA)
    return sheet


def spread_over(count: int, wanted: int) -> list[int]:
    """At most ``wanted`` indices of ``count`` pictures, evenly spaced, the first picture left out where it can be."""
    step = max(1, count // max(wanted, 1))
    return list(range(count - 1, -1, -step))[:wanted][::-1]
