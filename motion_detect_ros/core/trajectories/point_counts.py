"""How many points there are in boxes."""

from __future__ import annotations

import cv2
import numpy as np
import numpy.typing as npt

from motion_detect_ros.core.types import DoubleArray, FloatArray


class PointCounts:
    """How many points there are in a box, from their summed-area table (Crow 1984)."""

    def __init__(self, places: FloatArray, shape: tuple[int, ...]) -> None:
        """places: (N, 2) pixels; shape: (h, w)."""
        there = np.zeros(shape, np.uint8)
        columns, rows = np.rint(places).astype(np.intp).T
        there[rows, columns] = 1
        self._sums = cv2.integral(there)

    def within(self, low: DoubleArray, high: DoubleArray, margin_px: float) -> npt.NDArray[np.int32]:
        """(K,) in boxes grown by a margin; two in the same pixel are one. low, high: (K, 2) pixels."""
        sums = self._sums
        height, width = sums.shape
        left, top = np.maximum(np.rint(low - margin_px), 0.0).astype(np.intp).T
        right, bottom = np.minimum(np.rint(high + margin_px), [width - 1, height - 1]).astype(np.intp).T
        counts: npt.NDArray[np.int32] = sums[bottom, right] - sums[top, right] - sums[bottom, left] + sums[top, left]
        return counts
