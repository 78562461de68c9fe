"""Warping images and points by 3 x 3 matrices, and between resolutions."""

from __future__ import annotations

from functools import lru_cache

import cv2
import numpy as np

from motion_detect_ros.core.kernels import kernel
from motion_detect_ros.core.types import ByteArray, DoubleArray, FloatArray


def at_scale(matrix: DoubleArray, scale: float) -> DoubleArray:
    """A full-resolution pixel warp, (3, 3), as the same warp between images shrunk by ``scale`` (over 0).

    Pixel centres sit at whole numbers, so x_small = (x + 0.5) * scale - 0.5.
    """
    shift = 0.5 * scale - 0.5
    down = np.array([[scale, 0.0, shift], [0.0, scale, shift], [0.0, 0.0, 1.0]])
    scaled: DoubleArray = down @ matrix @ inverse(down)
    return scaled


def at_full_resolution(points: FloatArray, scale: float) -> FloatArray:
    """(N, 2) float32 pixels of an image shrunk by ``scale`` as full-resolution pixels; centres at whole numbers."""
    full: FloatArray = (points + np.float32(0.5)) / np.float32(scale) - np.float32(0.5)
    return full


def points_at_scale(points: FloatArray, scale: float) -> FloatArray:
    """(N, 2) float32 pixels of an image, in the same image at ``scale`` of its size; centres as in ``at_scale``."""
    scaled: FloatArray = points * np.float32(scale) + np.float32(0.5 * scale - 0.5)
    return scaled


def stabilise(earlier: ByteArray, matrix: DoubleArray) -> ByteArray:
    """``earlier``, (h, w) uint8, warped onto the later frame; border pixels are replicated.

    matrix: (3, 3) earlier pixel -> later pixel, same resolution.
    """
    height, width = earlier.shape[:2]
    options = {'flags': cv2.INTER_LINEAR, 'borderMode': cv2.BORDER_REPLICATE}
    warped: ByteArray
    if matrix[2, :2].any():
        warped = cv2.warpPerspective(earlier, matrix, (width, height), **options)
    else:  # the same in less time
        warped = cv2.warpAffine(earlier, matrix[:2] / matrix[2, 2], (width, height), **options)
    return warped


@lru_cache(maxsize=8)
def grid_points(rows: int, columns: int, width: int, height: int) -> FloatArray:
    """(rows, columns, 2) float32: the full-resolution pixel (x, y) at the centre of every grid cell; read-only."""
    x = (np.arange(columns, dtype=np.float32) + 0.5) * (width / columns) - 0.5
    y = (np.arange(rows, dtype=np.float32) + 0.5) * (height / rows) - 0.5
    points = np.stack(np.meshgrid(x, y), axis=-1).astype(np.float32)
    points.flags.writeable = False
    return points


def inverse(matrix: DoubleArray) -> DoubleArray:
    """(3, 3) the inverse warp. Raises: numpy.linalg.LinAlgError for a singular matrix."""
    return np.asarray(np.linalg.inv(matrix), np.float64)


def apply(matrix: DoubleArray, points: FloatArray) -> FloatArray:
    """(..., 2) float32 points, pixels, transformed by a (3, 3) matrix, with the perspective division."""
    moved = np.empty(points.shape, points.dtype)
    _apply(matrix.astype(np.float32), np.ascontiguousarray(points).reshape(-1, 2), moved.reshape(-1, 2))
    return moved


@kernel(error_model='numpy')
def _apply(m, points, moved):  # type: ignore[no-untyped-def]
    a, b, c, d, e, f, g, h, i = m[0, 0], m[0, 1], m[0, 2], m[1, 0], m[1, 1], m[1, 2], m[2, 0], m[2, 1], m[2, 2]
    for n in range(len(points)):
        x, y = points[n, 0], points[n, 1]
        depth = g * x + h * y + i
        moved[n, 0] = (a * x + b * y + c) / depth
        moved[n, 1] = (d * x + e * y + f) / depth
