"""Noise of the points of a neighbourhood: a blurred grid of mean lengths."""

from __future__ import annotations

import cv2
import numpy as np
import numpy.typing as npt

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
        self._places = (points / np.float32(self._cell_px)).astype(np.float32)
        column, row = self._places.astype(np.intp).T
        self._cells: npt.NDArray[np.intp] = row * self._shape[1] + column
        self._blurred_count = self._blurred(np.bincount(self._cells, minlength=self._size))

    @property
    def _size(self) -> int:
        return self._shape[0] * self._shape[1]

    def local_sigma(self, lengths: DoubleArray, sigma: float) -> DoubleArray:
        """(N,) mean of ``lengths`` around each point, at least ``sigma``, that of the whole image; pixels."""
        cut = np.minimum(lengths, CUT_SIGMAS * sigma)
        total = self._blurred(np.bincount(self._cells, cut, self._size))
        mean = (total + PRIOR_POINTS * sigma) / (self._blurred_count + PRIOR_POINTS)
        sampled = cv2.remap(mean.astype(np.float32), self._places[:, :1] - 0.5, self._places[:, 1:] - 0.5,
                            cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE)
        return np.maximum(sigma, sampled[:, 0].astype(np.float64))

    def _blurred(self, values: npt.NDArray[np.generic]) -> FloatArray:
        grid = values.reshape(self._shape).astype(np.float32)
        out: FloatArray = cv2.GaussianBlur(grid, BLUR_CELLS, BLUR_SIGMA_CELLS, borderType=cv2.BORDER_REPLICATE)
        return out
