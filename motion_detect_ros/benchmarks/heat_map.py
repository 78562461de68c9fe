"""Grids of shares as pictures: a colour and a number a cell, values of both axes, a title."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import cv2
import numpy as np

from motion_detect_ros.core.types import ByteArray, DoubleArray

CELL_PX, LEFT_PX, TOP_PX, BOTTOM_PX, RIGHT_PX = (64, 44), 64, 40, 52, 16
PAPER_BGR, INK_BGR = (255, 255, 255), (40, 40, 40)
#: From none to all: dark violet, teal, light yellow, so that grey prints keep the order.
_STOPS = np.array([[84, 1, 68], [140, 110, 40], [110, 190, 60], [120, 240, 245]], np.float64)
_FONT, _SCALE = cv2.FONT_HERSHEY_SIMPLEX, 0.45
#: Cells lighter than this have dark numbers.
_LIGHT_GRAY = 120


@dataclass(frozen=True)
class HeatMap:
    """``shares``: (rows, columns) 0..1, NaN = empty; ``rows``, ``columns``: values of the axes."""

    title: str
    row_name: str
    column_name: str
    rows: Sequence[float]
    columns: Sequence[float]
    shares: DoubleArray


def color_of_share(share: float) -> tuple[int, int, int]:
    """BGR of 0..1, linear between the stops."""
    place = min(max(share, 0.0), 1.0) * (len(_STOPS) - 1)
    low = min(int(place), len(_STOPS) - 2)
    blue, green, red = _STOPS[low] + (place - low) * (_STOPS[low + 1] - _STOPS[low])
    return round(blue), round(green), round(red)


def draw_heat_map(heat: HeatMap) -> ByteArray:
    """(H, W, 3) uint8 BGR; the first row is at the bottom, as on a graph."""
    cell_w, cell_h = CELL_PX
    height = TOP_PX + cell_h * len(heat.rows) + BOTTOM_PX
    canvas = np.full((height, LEFT_PX + cell_w * len(heat.columns) + RIGHT_PX, 3), PAPER_BGR, np.uint8)
    _write(canvas, heat.title, LEFT_PX, 16)
    _write(canvas, heat.row_name, 6, TOP_PX - 8)
    for row, value in enumerate(heat.rows):
        top = TOP_PX + cell_h * (len(heat.rows) - 1 - row)
        _write(canvas, f'{value:g}', 20, top + cell_h // 2 + 5)
        for column, share in enumerate(heat.shares[row].tolist()):
            left = LEFT_PX + cell_w * column
            if np.isfinite(share):
                _cell(canvas, left, top, share)
    bottom = TOP_PX + cell_h * len(heat.rows)
    for column, value in enumerate(heat.columns):
        _write(canvas, f'{value:g}', LEFT_PX + cell_w * column + cell_w // 2 - 12, bottom + 18)
    _write(canvas, heat.column_name, LEFT_PX, bottom + 40)
    return canvas


def side_by_side(pictures: Sequence[ByteArray]) -> ByteArray:
    """One picture, all top edges in line."""
    height = max(picture.shape[0] for picture in pictures)
    return np.hstack([cv2.copyMakeBorder(picture, 0, height - picture.shape[0], 0, 0, cv2.BORDER_CONSTANT,
                                         value=PAPER_BGR) for picture in pictures])


def _cell(canvas: ByteArray, left: int, top: int, share: float) -> None:
    color = color_of_share(share)
    cv2.rectangle(canvas, (left, top), (left + CELL_PX[0] - 2, top + CELL_PX[1] - 2), color, cv2.FILLED)
    ink = INK_BGR if float(np.mean(color)) > _LIGHT_GRAY else PAPER_BGR
    _write(canvas, f'{100 * share:.0f}', left + CELL_PX[0] // 2 - 13, top + CELL_PX[1] // 2 + 5, ink)


def _write(canvas: ByteArray, text: str, left: int, baseline: int, color: tuple[int, int, int] = INK_BGR) -> None:
    cv2.putText(canvas, text, (left, baseline), _FONT, _SCALE, color, 1, cv2.LINE_AA)
