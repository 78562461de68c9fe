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
    part = gray[top - MARGIN_PX - 1:bottom + MARGIN_PX + 1, left - MARGIN_PX - 1:right + MARGIN_PX + 1]
    for r in range(rows + 2 * MARGIN_PX):  # from 0 on, not from the part's place: no index could be negative
        for c in range(columns + 2 * MARGIN_PX):
            a, b = np.int32(part[r, c]), np.int32(part[r, c + 2])
            d, e = np.int32(part[r + 2, c]), np.int32(part[r + 2, c + 2])
            across = b + e - a - d + 2 * (np.int32(part[r + 1, c + 2]) - np.int32(part[r + 1, c]))
            down = d + e - a - b + 2 * (np.int32(part[r + 2, c + 1]) - np.int32(part[r, c + 1]))
            products[0, r, c] = across * across
            products[1, r, c] = across * down
            products[2, r, c] = down * down
    for r in range(rows):
        for which in range(3):
            for c in range(columns + 2 * MARGIN_PX):
                products[which, r, c] += (products[which, r + 1, c] + products[which, r + 2, c]
                                          + products[which, r + 3, c] + products[which, r + 4, c])
        for c in range(columns):
            xx = xy = yy = np.float32(0.0)
            for near in range(WINDOW_PX):
                xx += np.float32(products[0, r, c + near])
                xy += np.float32(products[1, r, c + near])
                yy += np.float32(products[2, r, c + near])
            half = np.float32(0.5) * (xx - yy)
            response[r, c] = np.float32(SCALE * SCALE) * (
                np.float32(0.5) * (xx + yy) - np.sqrt(half * half + xy * xy))
