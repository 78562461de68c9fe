"""Noise of the points of a neighbourhood: a blurred grid of mean lengths."""

from __future__ import annotations

import cv2
import numpy as np

from motion_detect_ros.core.kernels import kernel
from motion_detect_ros.core.types import DoubleArray, FloatArray

#: Cell of the grid, share of the image width (48 of 960 pixels).
CELL_SHARE = 0.05
#: Lengths are cut at so many deviations; weight of the whole image's deviation, in points.
CUT_SIGMAS, PRIOR_POINTS = 3.0, 4.0
#: Blur of the grid: window and deviation, cells.
BLUR_CELLS, BLUR_SIGMA_CELLS = (5, 5), 1.0


class PointGrid:
    """A coarse grid over the image with a fixed set of points, (N, 2) pixels."""

    def __init__(self, points: FloatArray, width: int, height: int) -> None:
        self._cell_px = CELL_SHARE * width
        self._shape = (int(height / self._cell_px) + 1, int(width / self._cell_px) + 1)
        self._places = points / np.float32(self._cell_px)
        self._blurred_count = self._blurred(np.ones(len(points)), 1.0)

    def local_sigma(self, lengths: DoubleArray, sigma: float) -> DoubleArray:
        """(N,) mean of ``lengths`` around each point, at least ``sigma``, that of the whole image; pixels."""
        total = self._blurred(lengths, CUT_SIGMAS * sigma)
        mean = (total + PRIOR_POINTS * sigma) / (self._blurred_count + PRIOR_POINTS)
        local = np.empty(len(lengths))
        _interpolate(mean.astype(np.float32), self._places, sigma, local)
        return local

    def _blurred(self, lengths: DoubleArray, longest: float) -> FloatArray:
        sums = np.zeros(self._shape)
        _add(self._places, lengths, longest, sums)
        out: FloatArray = cv2.GaussianBlur(
            sums.astype(np.float32), BLUR_CELLS, BLUR_SIGMA_CELLS, borderType=cv2.BORDER_REPLICATE)
        return out


@kernel()
def _add(places, lengths, longest, sums):  # type: ignore[no-untyped-def]
    """Adds the lengths (N,), cut at ``longest``, to the cells of ``sums`` (rows, columns) that they are in.

    places: (N, 2), cells.
    """
    for n in range(len(places)):
        sums[int(places[n, 1]), int(places[n, 0])] += min(lengths[n], longest)


@kernel()
def _interpolate(grid, places, least, values):  # type: ignore[no-untyped-def]
    """``values``: (N,) of ``grid``, (rows, columns) of cell centres, at places (N, 2), cells, at least ``least``.

    Bilinear; beyond the outer centres as at the border.
    """
    zero, half, one = np.float32(0.0), np.float32(0.5), np.float32(1.0)
    bottom, right = np.float32(grid.shape[0] - 1), np.float32(grid.shape[1] - 1)
    for n in range(len(places)):
        x, y = min(max(zero, places[n, 0] - half), right), min(max(zero, places[n, 1] - half), bottom)
        c, r = min(int(x), grid.shape[1] - 2), min(int(y), grid.shape[0] - 2)
        u, v = x - np.float32(c), y - np.float32(r)
        value = ((one - v) * ((one - u) * grid[r, c] + u * grid[r, c + 1])
                 + v * ((one - u) * grid[r + 1, c] + u * grid[r + 1, c + 1]))
        values[n] = max(least, float(value))
