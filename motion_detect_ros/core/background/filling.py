"""Flow where it is hidden, from the known cells around: normalised convolution (Knutsson and Westin 1993)."""

from __future__ import annotations

import cv2
import numpy as np

from motion_detect_ros.core.kernels import kernel
from motion_detect_ros.core.types import BoolArray, FloatArray

#: Windows tried to fill, cells; share of known cells a window needs.
FILL_CELLS, MIN_FILL_SHARE = (9, 17, 33, 65, 129), 0.02


def filled_from_around(flow: FloatArray, hidden: BoolArray) -> FloatArray:
    """(gh, gw, 2) ``flow`` with the cells of ``hidden`` (gh, gw) replaced by the mean of the known ones around.

    The windows grow, so that the nearest known cells count; 0 where the largest one holds too few.
    """
    seen = (~hidden).astype(np.uint8)
    known = cv2.copyTo(flow, seen)  # 0 elsewhere
    filled, missing, counts = known.copy(), hidden.copy(), seen.astype(np.float32)
    down, across = np.empty((3, flow.shape[1])), np.empty((flow.shape[1] + max(FILL_CELLS), 3))
    for size in FILL_CELLS:
        if not _fill(known, counts, size // 2, down, across, missing, filled):
            break
    return filled


@kernel(error_model='numpy')
def _fill(known, counts, half, down, across, missing, filled):  # type: ignore[no-untyped-def]
    """Fills ``missing`` (gh, gw) cells from windows of 2 ``half`` + 1, mirrored at the borders; returns how many stay.

    known: (gh, gw, 2) flow, counts: (gh, gw) 1, both 0 in hidden cells; filled: (gh, gw, 2). Scratch: down: (3, gw)
    sums of both over the rows of the window, across: (gw + 2 half + 1, 3) or longer, sums of these up to a column.
    """
    rows, columns = missing.shape
    least, left = MIN_FILL_SHARE * (2 * half + 1) ** 2, 0
    down[:] = 0.0
    for row in range(-half, half):
        _add(known, counts, _mirrored(row, rows), 1.0, down)
    for row in range(rows):
        _add(known, counts, _mirrored(row + half, rows), 1.0, down)
        last = columns - 1
        while last >= 0 and not missing[row, last]:
            last -= 1
        if last >= 0:
            _add_up(down, half, last, across)
        for column in range(last + 1):
            if missing[row, column]:
                end = column + 2 * half + 1
                count = across[end, 2] - across[column, 2]
                if count > least:
                    missing[row, column] = False
                    filled[row, column, 0] = (across[end, 0] - across[column, 0]) / count
                    filled[row, column, 1] = (across[end, 1] - across[column, 1]) / count
                else:
                    left += 1
        _add(known, counts, _mirrored(row - half, rows), -1.0, down)
    return left


@kernel()
def _add(known, counts, row, factor, down):  # type: ignore[no-untyped-def]
    for column in range(down.shape[1]):
        down[0, column] += factor * known[row, column, 0]
        down[1, column] += factor * known[row, column, 1]
        down[2, column] += factor * counts[row, column]


@kernel()
def _add_up(down, half, last, across):  # type: ignore[no-untyped-def]
    """``across`` at n: sums of the columns from -half to n - half, without the latter; up to the window of ``last``."""
    x, y, count = 0.0, 0.0, 0.0
    for n in range(last + 2 * half + 2):
        across[n, 0], across[n, 1], across[n, 2] = x, y, count
        column = _mirrored(n - half, down.shape[1])
        x, y, count = x + down[0, column], y + down[1, column], count + down[2, column]


@kernel()
def _mirrored(place, count):  # type: ignore[no-untyped-def]
    """The cell that stands for one beyond the border, which is not repeated (OpenCV's BORDER_REFLECT_101)."""
    if count == 1:
        return 0
    while place < 0 or place >= count:
        place = -place if place < 0 else 2 * (count - 1) - place
    return place
