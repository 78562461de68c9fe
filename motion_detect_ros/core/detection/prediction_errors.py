"""How far the grey values that a flow predicts from an earlier image are from those that are there."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from motion_detect_ros.core.detection.enlarging import enlarge_row, find_columns
from motion_detect_ros.core.detection.image_pair import ImagePair, grey_before
from motion_detect_ros.core.geometry.boxes import Box
from motion_detect_ros.core.kernels import kernel
from motion_detect_ros.core.threads import HELPERS
from motion_detect_ros.core.types import BoolArray, FloatArray

#: Window over which errors are averaged, and its pixels beside its centre.
WINDOW_PX = 3
BESIDE_PX = WINDOW_PX // 2
#: Side of the squares of an image in which errors are computed where any is asked for, pixels.
TILE_PX = 32
#: Fewest tiles worth a thread.
LEAST_TILES = 60


@dataclass(frozen=True)
class PredictionErrors:
    """``values``: (h, w) uint16 squared errors of the pixels of ``box``, which holds all that are asked for and those
    beside them.
    """

    values: npt.NDArray[np.uint16]
    box: Box

    @classmethod
    def within(cls, pair: ImagePair, box: Box, flow: FloatArray) -> PredictionErrors:
        """Those of a box, under a ``flow`` beyond the ego-motion that is the same everywhere, (2,) pixels."""
        height, width = pair.current.shape
        box = box.grown(BESIDE_PX, width, height)
        values = np.empty((box.height, box.width), np.uint16)
        _fill(pair, box, flow.reshape(1, 1, 2), max(values.shape), np.ones((1, 1), np.bool_), values, 1)
        return cls(values, box)

    @classmethod
    def near(cls, pair: ImagePair, boxes: Sequence[Box], flow: FloatArray) -> PredictionErrors:
        """Those of several boxes, under the flow (gh, gw, 2) of a grid over the image, pixels."""
        height, width = pair.current.shape
        wanted = np.zeros((-(-height // TILE_PX), -(-width // TILE_PX)), np.bool_)
        for box in (each.grown(BESIDE_PX, width, height) for each in boxes):
            wanted[box.top // TILE_PX:-(-box.bottom // TILE_PX), box.left // TILE_PX:-(-box.right // TILE_PX)] = True
        values = np.empty((height, width), np.uint16)
        _fill(pair, Box(0, 0, width, height), flow, TILE_PX, wanted, values,
              HELPERS.parts(int(wanted.sum()), LEAST_TILES))
        return cls(values, Box(0, 0, width, height))


def _fill(
    pair: ImagePair, box: Box, flow: FloatArray, tile_px: int, wanted: BoolArray, values: npt.NDArray[np.uint16],
    parts: int,
) -> None:
    """``values`` of a box where its tiles are ``wanted``; parts: threads."""
    pictures, back = pair.pictures, pair.back

    def every(first: int) -> None:
        _fill_tiles(*pictures, back, box.left, box.top, flow, tile_px, wanted, first, parts,
                    np.empty((2, box.width), np.uint32), np.empty((4, box.width), np.uint8),
                    np.empty((9, box.width), np.float32), values)

    HELPERS.share(every, range(parts))


@kernel()
def _fill_tiles(  # type: ignore[no-untyped-def]
    current, reference, back, left, top, flow, tile_px, wanted, first, step, indices, corners, rows, errors,
):
    """``errors``: (h, w) at left, top of the current image, in every ``step``-th row of tiles, ``wanted`` or not.

    flow: (gh, gw, 2) of a grid over the image, (1, 1, 2) where it is the same everywhere; scratch: indices: (2, w)
    uint32, corners: (4, w) uint8, rows: (9, w).
    """
    (height, width), bands = errors.shape, wanted.shape[0]
    corner, place, line, lines, even = indices[0], rows[:2], rows[2:4], rows[4:8], flow.shape[0] * flow.shape[1] == 1
    for band in range(first, bands, step):
        column = 0
        while column < wanted.shape[1]:
            start = column
            while column < wanted.shape[1] and wanted[band, column]:
                column += 1
            if column == start:
                column += 1
                continue
            begin, end, above = start * tile_px, min(width, column * tile_px), -1
            across, down = (flow[0, 0, :1], flow[0, 0, 1:]) if even else (line[0, :end - begin], line[1, :end - begin])
            west, share = indices[1, :end - begin], rows[8, :end - begin]
            if not even:
                find_columns(left + begin, flow.shape[1], current.shape[1], west, share)
            for r in range(band * tile_px, min(height, (band + 1) * tile_px)):
                if not even:
                    above = enlarge_row(flow, top + r, current.shape[0], west, share, above, lines, line)
                row_errors(current, reference, back, left + begin, top + r, across, down, place, corner, corners,
                           errors[r, begin:end])


@kernel(inline='always')
def row_errors(  # type: ignore[no-untyped-def]
    current, reference, back, left, row, across, down, place, corner, corners, errors,
):
    """``errors``: (w,) squared ones of the grey values from ``left`` on of a row of the current image under a flow,
    ``across`` and ``down`` (w,), or (1,) where it is the same everywhere.

    Scratch of w or more: place: (2, .), corner: (.,) uint32, corners: (4, .) uint8. A row at a time, as only the
    look-up of pixels cannot be vectorised.
    """
    width = len(errors)
    x, y = place[0, :width], place[1, :width]
    if len(across) == 1:
        for c in range(width):
            x[c], y[c] = np.float32(np.int32(left + c)) - across[0], np.float32(row) - down[0]
    else:
        for c in range(width):
            x[c], y[c] = np.float32(np.int32(left + c)) - across[c], np.float32(row) - down[c]
    grey_before(reference, back, x, y, corner, corners)
    here = current[row, left:left + width]
    for c in range(width):
        miss = np.int32(here[c]) - np.int32(x[c])
        errors[c] = np.uint16(miss * miss)


@kernel()
def row_means(errors, row, begin, sums, means):  # type: ignore[no-untyped-def]
    """``means``: (w,) of errors (., .) from ``begin`` on of a row, each over its window; beyond the border those of the
    pixels within are mirrored. sums: (w + 2 or more,) int32.
    """
    last, width = errors.shape[1] - 1, len(means)
    first, after = max(0, begin - 1), min(last, begin + width) + 1
    above, own, below = _three_rows(errors, row, first, after)
    three = sums[first - begin + 1:after - begin + 1]
    for n in range(len(three)):
        three[n] = np.int32(above[n]) + np.int32(own[n]) + np.int32(below[n])
    if begin == 0:
        sums[0] = sums[1 + min(1, last)]
    if begin + width > last:
        sums[width + 1] = sums[width - 1 if last > 0 else 1]
    west, east = sums[:width], sums[2:width + 2]
    middle = sums[1:width + 1]
    for n in range(width):
        means[n] = np.float64(west[n] + middle[n] + east[n]) * (1.0 / WINDOW_PX ** 2)


@kernel(inline='always')
def _three_rows(errors, row, first, after):  # type: ignore[no-untyped-def]
    """Columns ``first`` .. ``after`` of the row above a row, of itself and of the one below, mirrored at the ends."""
    last = errors.shape[0] - 1
    above, below = row - 1 if row > 0 else min(1, last), row + 1 if row < last else max(last - 1, 0)
    return errors[above, first:after], errors[row, first:after], errors[below, first:after]
