"""Where trajectories start: strongest corner (Shi and Tomasi 1994) of each free cell, denser where things change."""

from __future__ import annotations

import cv2
import numpy as np

from motion_detect_ros.core.kernels import kernel
from motion_detect_ros.core.trajectories.changes import changed_pixels
from motion_detect_ros.core.trajectories.corner_response import corner_response, scratch
from motion_detect_ros.core.trajectories.recent_frames import RecentFrames
from motion_detect_ros.core.types import BoolArray, FloatArray

#: Cells of one point each, pixels, everywhere and where the image changed.
CELL_PX, CHANGED_CELL_PX = 16, 5
#: Cells within so many pixels of a moving point are filled first: its object has texture that no point is on yet.
NEAR_MOVING_PX = 30.0
#: Pixels at the image border without points.
BORDER_PX = 5
#: Least corner response (OpenCV's scale, 8-bit images).
LEAST_RESPONSE = 2e-4
#: Change: against the stabilised frame so long ago, seconds, in so many pixels of a cell.
CHANGE_S, CHANGED_PIXELS = 0.16, 3
SEED = 0

#: In place of a mask: all of the image.
_EVERYWHERE = np.ones((0, 0), np.bool_)


class NewPoints:
    """Places of new points. Free cells are filled near moving points first, and in random order, so that a full quota
    thins all other regions alike.
    """

    def __init__(self, max_points: int) -> None:
        self._max_points, self._scratch = max_points, scratch(CELL_PX)
        self.reset()

    def reset(self) -> None:
        """Start the random order anew."""
        self._random = np.random.default_rng(SEED)

    def places(
        self, taken: FloatArray, frames: RecentFrames, mask: BoolArray | None, moving: FloatArray,
    ) -> FloatArray:
        """(n, 2) pixels, n + N at most the quota.

        taken: (N, 2) where points are; mask: (h, w), False = no points; moving: (m, 2) where points move.
        """
        places = np.empty((max(0, self._max_points - len(taken)), 2), np.float32)
        if not len(places):
            return places
        everywhere = np.ones(frames[0].half.shape, np.bool_)
        found = self._fill(places, 0, frames, mask, everywhere, taken, CELL_PX, moving[:0])
        ago = frames.nearest(CHANGE_S)
        if ago:
            so_far = np.concatenate([taken, places[:found]])
            changed = changed_pixels(frames, [ago])
            found = self._fill(places, found, frames, mask, changed, so_far, CHANGED_CELL_PX, moving)
        return places[:found]

    def _fill(
        self, places: FloatArray, found: int, frames: RecentFrames, mask: BoolArray | None, wanted: BoolArray,
        taken: FloatArray, cell_px: int, moving: FloatArray,
    ) -> int:
        gray = frames[0].gray
        rows, columns = (-(-size // cell_px) for size in gray.shape)
        free = np.ones((rows, columns), np.bool_)
        column, row = (taken // cell_px).astype(np.intp).T
        free[row, column] = False
        order = self._random.permutation(np.flatnonzero(free))
        if len(moving):
            order = order[np.argsort(_far_from(moving, (rows, columns), cell_px)[order], kind='stable')]
        return int(_strongest(np.require(gray, None, ['C', 'W']), _EVERYWHERE if mask is None else mask, wanted, order,
                              columns, cell_px, *self._scratch, places, found))


def _far_from(moving: FloatArray, shape: tuple[int, int], cell_px: int) -> BoolArray:
    """(cells,) row by row, which are over ``NEAR_MOVING_PX`` from every place of ``moving``, (m, 2) pixels, m > 0."""
    without = np.ones(shape, np.uint8)
    column, row = (moving // cell_px).astype(np.intp).T
    without[row, column] = 0
    distance: FloatArray = cell_px * cv2.distanceTransform(without, cv2.DIST_L2, cv2.DIST_MASK_3)
    return distance.ravel() > NEAR_MOVING_PX


@kernel()
def _strongest(  # type: ignore[no-untyped-def]
    gray, mask, wanted, order, columns, cell_px, products, response, places, found,
):
    """Writes the strongest place of each cell of ``order`` to ``places`` from ``found`` on; returns the new number.

    mask: (h, w) or empty; wanted: (h / 2, w / 2); products, response: of ``scratch``.
    """
    height, width = gray.shape
    for cell in order:
        if found >= len(places):
            break
        top, left = (cell // columns) * cell_px, (cell % columns) * cell_px
        top, bottom = max(top, BORDER_PX), min(top + cell_px, height - BORDER_PX)
        left, right = max(left, BORDER_PX), min(left + cell_px, width - BORDER_PX)
        count = 0
        for r in range(top // 2, (bottom + 1) // 2):
            across = 0
            for c in range(left // 2, (right + 1) // 2):
                across += wanted[r, c] * (min(right, 2 * c + 2) - max(left, 2 * c))
            count += across * (min(bottom, 2 * r + 2) - max(top, 2 * r))
        if count < CHANGED_PIXELS:
            continue
        corner_response(gray, top, bottom, left, right, products, response)
        best = np.float32(LEAST_RESPONSE)
        x = y = -1
        for r in range(top, bottom):
            for c in range(left, right):
                if response[r - top, c - left] > best and (len(mask) == 0 or mask[r, c]):
                    best, x, y = response[r - top, c - left], c, r
        if x >= 0:
            places[found, 0], places[found, 1] = x, y
            found += 1
    return found
