"""Corner response (Shi and Tomasi 1994) of small parts of an image: most cells have a point already and need none."""

from __future__ import annotations

import numpy as np

from motion_detect_ros.core.kernels import kernel
from motion_detect_ros.core.types import FloatArray

#: Window over which the products of the derivatives are summed, pixels; 3 x 3 Sobel derivatives need one more.
WINDOW_PX = 5
MARGIN_PX = WINDOW_PX // 2
#: Sobel derivatives and window sums as means of grey values of 0 .. 1, as OpenCV has them.
SCALE = 1.0 / (4 * WINDOW_PX * 255)


def scratch(side_px: int) -> tuple[np.ndarray[tuple[int, ...], np.dtype[np.int32]], FloatArray]:
    """Buffers of ``corner_response`` for parts up to ``side_px`` pixels wide and high."""
    wide = side_px + 2 * MARGIN_PX
    return np.empty((3, wide, wide), np.int32), np.empty((side_px, side_px), np.float32)


@kernel()
def corner_response(gray, top, bottom, left, right, products, response):  # type: ignore[no-untyped-def]
    """``response``: from its corner on, the smaller eigenvalue of the structure tensor of the pixels of a part.

    As ``cv2.cornerMinEigenVal(gray, 5, ksize=3)`` has it but for rounding. gray: (h, w) uint8; top .. right: the part,
    3 pixels and more from the image border; products, response: of ``scratch``.
    """
    rows, columns = bottom - top, right - left
    wide = columns + 2 * MARGIN_PX
    first, last = left - MARGIN_PX - 1, right + MARGIN_PX + 1
    for r in range(rows + 2 * MARGIN_PX):  # rows as arrays of their own: indices that cannot be negative are quick
        y = top + r - MARGIN_PX
        above, here, below = gray[y - 1, first:last], gray[y, first:last], gray[y + 1, first:last]
        xx, xy, yy = products[0, r], products[1, r], products[2, r]
        for c in range(wide):
            a, b, d, e = np.int32(above[c]), np.int32(above[c + 2]), np.int32(below[c]), np.int32(below[c + 2])
            across = b + e - a - d + 2 * (np.int32(here[c + 2]) - np.int32(here[c]))
            down = d + e - a - b + 2 * (np.int32(below[c + 1]) - np.int32(above[c + 1]))
            xx[c] = across * across
            xy[c] = across * down
            yy[c] = down * down
    for r in range(rows):
        for which in range(3):
            total, second, third, fourth, fifth = (
                products[which, r], products[which, r + 1], products[which, r + 2], products[which, r + 3],
                products[which, r + 4])
            for c in range(wide):
                total[c] += second[c] + third[c] + fourth[c] + fifth[c]
        xx, xy, yy, smaller = products[0, r], products[1, r], products[2, r], response[r]
        for c in range(columns):
            x = np.float32(xx[c] + xx[c + 1] + xx[c + 2] + xx[c + 3] + xx[c + 4])
            both = np.float32(xy[c] + xy[c + 1] + xy[c + 2] + xy[c + 3] + xy[c + 4])
            y = np.float32(yy[c] + yy[c + 1] + yy[c + 2] + yy[c + 3] + yy[c + 4])
            half = np.float32(0.5) * (x - y)
            smaller[c] = np.float32(SCALE * SCALE) * (np.float32(0.5) * (x + y) - np.sqrt(half * half + both * both))
