"""Current and earlier image, and the noise of their grey values."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from motion_detect_ros.core.detection.photometric_kernels import grey_before
from motion_detect_ros.core.geometry.robust import MAD_TO_SIGMA
from motion_detect_ros.core.geometry.warp import inverse
from motion_detect_ros.core.kernels import kernel
from motion_detect_ros.core.types import BoolArray, ByteArray, DoubleArray, FloatArray

#: Least image noise, grey levels (quantisation, compression).
MIN_NOISE_GRAY = 1.5


@dataclass(frozen=True)
class ImagePair:
    """Current and reference grey image, (h, w) uint8 each, ``matrix`` (3, 3) reference -> current, working pixels.

    ``mask``: (h, w) bool, pixels of the current image that show the scene; None = all.
    """

    current: ByteArray
    reference: ByteArray
    matrix: DoubleArray
    mask: BoolArray | None = None

    @cached_property
    def back(self) -> FloatArray:
        """(3, 3) float32: current -> reference pixel."""
        return inverse(self.matrix).astype(np.float32)

    @cached_property
    def pictures(self) -> tuple[ByteArray, ByteArray]:
        """Current and reference, as one kind of array that a kernel is compiled for once."""
        return np.require(self.current, None, ['C', 'W']), np.require(self.reference, None, ['C', 'W'])


def image_noise(pair: ImagePair, points: FloatArray, background: FloatArray) -> float:
    """Standard deviation of the grey-value error of the background flow (from the median absolute error).

    points: (n, m, 2) sample positions; background: (n, m, 2) motion beyond the ego-motion there, working pixels.
    """
    columns = points.shape[1]
    spread = _median_error(*pair.pictures, pair.back, points, background, np.zeros(256, np.int64),
                           np.eye(3, dtype=np.float32), np.empty((4, columns), np.float32),
                           np.empty(columns, np.uint32), np.empty((4, columns), np.uint8))
    return max(MIN_NOISE_GRAY, MAD_TO_SIGMA * float(spread))


@kernel()
def _median_error(  # type: ignore[no-untyped-def]
    current, reference, back, points, background_flow, counts, unmoved, place, corner, corners,
):
    """Median grey-value error at ``points`` (n, m, 2) under background flow; by counting, as errors are integers.

    counts: (256,) zeros; unmoved: (3, 3) identity; place: (4, m); corner: (m,) uint32; corners: (4, m) uint8.
    """
    rows, columns = points.shape[:2]
    x, y, before_x, before_y = place[0], place[1], place[2], place[3]
    for r in range(rows):
        for c in range(columns):
            x[c], y[c] = points[r, c, 0], points[r, c, 1]
            before_x[c], before_y[c] = x[c] - background_flow[r, c, 0], y[c] - background_flow[r, c, 1]
        grey_before(current, unmoved, x, y, columns, corner, corners)
        grey_before(reference, back, before_x, before_y, columns, corner, corners)
        for c in range(columns):
            counts[int(abs(x[c] - before_x[c]))] += 1
    total = rows * columns
    low = high = passed = 0
    while passed <= total // 2 and high < len(counts):
        if passed <= (total - 1) // 2:
            low = high
        passed += counts[high]
        high += 1
    return (low + high - 1) / 2.0
