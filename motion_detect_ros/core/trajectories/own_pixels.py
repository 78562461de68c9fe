"""Which pixels of a region are a cluster's own: near its points, and not nearer to those of another cluster.

Distances are chamfer distances of a 5 x 5 neighbourhood (Borgefors 1986) with the lengths of OpenCV's ``DIST_MASK_5``:
the shortest way in steps to the side, diagonal ones, and those of a knight in chess, found in two sweeps over the
region. In whole numbers, so that the lowest bit can tell whose point the way begins at.
"""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from motion_detect_ros.core.geometry.boxes import Box
from motion_detect_ros.core.kernels import kernel
from motion_detect_ros.core.types import BoolArray, FloatArray

#: One pixel in the units of distances; the bit below is set for points of other clusters.
PIXEL = 2 * 65536
#: Steps to the side, diagonal ones, those of a knight.
SIDE, DIAGONAL, KNIGHT = (2 * round(65536 * length) for length in (1.0, 1.4, 2.1969))
#: Where no way has led yet; steps may be added to it.
FAR = 2 ** 30
#: Steps lead so far over rows and columns.
BEYOND = 2


class NearestPoints:
    """The points of a frame, each of a cluster or of none."""

    def __init__(self, points: FloatArray, owner: npt.NDArray[np.intp]) -> None:
        """points: (N, 2) pixels; owner: (N,) number of the cluster of each, negative = none."""
        self._places, self._owner = np.rint(points).astype(np.intp), owner

    def keep_own(self, mask: BoolArray, region: Box, own: FloatArray, number: int, reach_px: float) -> None:
        """Clears the pixels of ``mask``, (h, w) of a region, that are farther than ``reach_px`` from the points ``own``
        or nearer to a point of another cluster than ``number`` than to any other in the region.

        own: (n, 2) pixels in the region.
        """
        distances = np.full((2, region.height + 2 * BEYOND, region.width + 2 * BEYOND), FAR, np.int32)
        _keep_own(mask, region.left, region.top, own, self._places, self._owner, number, np.float32(reach_px),
                  distances)


@kernel()
def _keep_own(mask, left, top, own, places, owner, number, reach, distances):  # type: ignore[no-untyped-def]
    """``mask``: as in ``NearestPoints.keep_own``.

    places: (N, 2) whole pixels; distances: (2, h + 4, w + 4) ``FAR``.
    """
    height, width = mask.shape
    near, nearest = distances[0], distances[1]
    for n in range(len(own)):
        near[int(np.rint(own[n, 1])) - top + BEYOND, int(np.rint(own[n, 0])) - left + BEYOND] = 0
    others = False
    for n in range(len(places)):
        c, r = places[n, 0] - left, places[n, 1] - top
        if 0 <= c < width and 0 <= r < height:
            other = owner[n] >= 0 and owner[n] != number
            nearest[r + BEYOND, c + BEYOND] = 1 if other else 0
            others |= other
    _spread(near)
    if others:
        _spread(nearest)
    for r in range(height):
        for c in range(width):
            if mask[r, c]:
                distance = np.float32(near[r + BEYOND, c + BEYOND]) / np.float32(PIXEL)
                mask[r, c] = distance <= reach and not (others and nearest[r + BEYOND, c + BEYOND] & 1)


@kernel()
def _spread(distances):  # type: ignore[no-untyped-def]
    """``distances``: (h + 4, w + 4) int32, 0 or 1 at some pixels and ``FAR`` elsewhere, then how far the nearest of
    them is, and its lowest bit: 0 where several are. Not within ``BEYOND`` of the edges.
    """
    rows, columns = distances.shape
    for r in range(BEYOND, rows - BEYOND):
        row = distances[r]
        _reach_row(row, distances[r - 1], distances[r - 2])
        for c in range(BEYOND, columns - BEYOND):
            row[c] = min(row[c], row[c - 1] + SIDE)
    for r in range(rows - BEYOND - 1, BEYOND - 1, -1):
        row = distances[r]
        _reach_row(row, distances[r + 1], distances[r + 2])
        for c in range(columns - BEYOND - 1, BEYOND - 1, -1):
            row[c] = min(row[c], row[c + 1] + SIDE)


@kernel()
def _reach_row(row, beside, beyond):  # type: ignore[no-untyped-def]
    """``row``: (w + 4,) distances, then the least of them and of those over the next row and the next but one."""
    for c in range(len(row) - 2 * BEYOND):
        knight = min(beyond[c + 1], beyond[c + 3], beside[c], beside[c + 4]) + np.int32(KNIGHT)
        diagonal = min(beside[c + 1], beside[c + 3]) + np.int32(DIAGONAL)
        side = beside[c + 2] + np.int32(SIDE)
        row[c + 2] = min(row[c + 2], knight, diagonal, side)
