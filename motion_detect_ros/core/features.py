"""Corners to track: Shi-Tomasi, spread evenly over the image."""

from __future__ import annotations

import cv2
import numpy as np

from motion_detect_ros.core.types import ByteArray, FloatArray

#: Window of the corner response, pixels.
BLOCK_PX = 5


def even_corners(
    gray: ByteArray, count: int, quality: float, ignore_top_px: int = 0, rows: int = 6, columns: int = 8,
) -> FloatArray:
    """The strongest corners of every cell of a ``rows`` x ``columns`` grid, so that one textured spot does not own all.

    gray: (H, W) uint8. Returns (N, 2) float32, pixels (x, y), N <= count.
    Source: Shi and Tomasi 1994 (smallest eigenvalue of the structure tensor), bucketing as in Kitt et al. 2010.
    """
    response = cv2.cornerMinEigenVal(gray, BLOCK_PX, ksize=3)
    response[:ignore_top_px + BLOCK_PX] = 0.0
    response[-BLOCK_PX:] = 0.0
    response[:, :BLOCK_PX] = 0.0
    response[:, -BLOCK_PX:] = 0.0
    peak = response == cv2.dilate(response, np.ones((2 * BLOCK_PX + 1, 2 * BLOCK_PX + 1), np.uint8))
    ys, xs = np.nonzero(peak & (response > quality * float(response.max())))
    cells = (ys * rows // gray.shape[0]) * columns + xs * columns // gray.shape[1]
    order = np.lexsort((-response[ys, xs], cells))
    keep = order[_rank_in_group(cells[order]) < max(1, count // (rows * columns))]
    return np.column_stack([xs[keep], ys[keep]]).astype(np.float32)


def _rank_in_group(sorted_groups: np.ndarray) -> np.ndarray:
    """Position of each element within its run of equal values: [3, 3, 5, 5, 5] -> [0, 1, 0, 1, 2]."""
    position = np.arange(len(sorted_groups))
    starts = np.flatnonzero(np.r_[True, sorted_groups[1:] != sorted_groups[:-1]][:len(sorted_groups)])
    return position - np.repeat(starts, np.diff(np.r_[starts, len(sorted_groups)]))
