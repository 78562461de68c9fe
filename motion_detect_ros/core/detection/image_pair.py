"""Current and earlier image, and how well a flow predicts the grey values of the one from the other."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np

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


@kernel(inline='always')
def grey_before(image, back, x, y, corner, corners):  # type: ignore[no-untyped-def]
    """``x``: (w,) positions with ``y``, then grey values of an image at what ``back`` makes of them, linear, rounded.

    Beyond the border of the image, and for NaN, those of the border. corner: (w,) uint32; corners: (4, w) uint8.
    """
    rows, columns = image.shape
    pixels, right, below = image.ravel(), np.uint32(min(1, columns - 1)), np.uint32(columns if rows > 1 else 0)
    northwest, northeast, southwest, southeast = corners[0], corners[1], corners[2], corners[3]
    _corners(back, rows, columns, x, y, corner)
    for n in range(len(x)):
        northwest[n], northeast[n] = pixels[corner[n]], pixels[corner[n] + right]
        southwest[n], southeast[n] = pixels[corner[n] + below], pixels[corner[n] + below + right]
    for n in range(len(x)):
        a, b, c, d = (np.float32(northwest[n]), np.float32(northeast[n]), np.float32(southwest[n]),
                      np.float32(southeast[n]))
        high, low = a + x[n] * (b - a), c + x[n] * (d - c)
        x[n] = np.rint(high + y[n] * (low - high))


@kernel(error_model='numpy')
def _corners(back, rows, columns, x, y, corner):  # type: ignore[no-untyped-def]
    """``corner``: (w,) upper left pixel, counted row by row, of the four around what ``back`` makes of ``x``, ``y``;
    these are the distances from it then, 0 .. 1.
    """
    a, b, c, d, e, f = back[0, 0], back[0, 1], back[0, 2], back[1, 0], back[1, 1], back[1, 2]
    g, h, i = back[2, 0], back[2, 1], back[2, 2]
    zero, last_x, last_y = np.float32(0.0), np.float32(columns - 1), np.float32(rows - 1)
    last_left, last_top = np.float32(max(columns - 2, 0)), np.float32(max(rows - 2, 0))
    for n in range(len(x)):
        depth = g * x[n] + h * y[n] + i
        px, py = (a * x[n] + b * y[n] + c) / depth, (d * x[n] + e * y[n] + f) / depth
        px, py = px if px > zero else zero, py if py > zero else zero
        px, py = px if px < last_x else last_x, py if py < last_y else last_y
        left, top = np.int32(px if px < last_left else last_left), np.int32(py if py < last_top else last_top)
        x[n], y[n] = px - np.float32(left), py - np.float32(top)
        corner[n] = np.uint32(top) * np.uint32(columns) + np.uint32(left)


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
        grey_before(current, unmoved, x, y, corner, corners)
        grey_before(reference, back, before_x, before_y, corner, corners)
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
