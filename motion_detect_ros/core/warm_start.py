"""The flow of the last frame as first guess of the next: carried along by the ego-motion, and turned round."""

from __future__ import annotations

import cv2
import numpy as np

from motion_detect_ros.core.types import DoubleArray, FloatArray
from motion_detect_ros.core.warp import apply, grid_points, inverse


def carried(shift: FloatArray, matrix: DoubleArray, width: int, height: int) -> FloatArray:
    """(rows, columns, 2) the displacements of the previous picture as the current one sees them.

    shift: (rows, columns, 2) displacement on a grid over the previous picture, pixels, NaN = unknown; matrix: (3, 3)
    previous pixel -> current pixel; width, height: of both pictures. What is unknown, or was outside, is zero: between
    stabilised pictures the ground stands still.
    """
    rows, columns = shift.shape[:2]
    points = grid_points(rows, columns, width, height)
    before = apply(inverse(matrix), points)
    cells = (before + 0.5) * np.array([columns / width, rows / height], np.float32) - 0.5
    known = cv2.remap(np.nan_to_num(shift), cells.astype(np.float32), None, cv2.INTER_LINEAR)
    moved: FloatArray = apply(matrix, before + known) - points
    moved[~np.isfinite(moved).all(axis=-1)] = 0.0  # OpenCV's DIS does not survive any other first guess
    return moved


def turned_round(shift: FloatArray, width: int, height: int) -> FloatArray:
    """(rows, columns, 2) the way back of ``shift``: set where each cell arrives, the longest where several do."""
    rows, columns = shift.shape[:2]
    cells = np.array([columns / width, rows / height], np.float32)
    arrival = np.floor(grid_points(rows, columns, columns, rows) + shift * cells + 0.5)
    column, row = np.moveaxis(arrival.astype(int), -1, 0)
    order = np.argsort(np.hypot(shift[..., 0], shift[..., 1]), axis=None, kind='stable')
    order = order[((column >= 0) & (column < columns) & (row >= 0) & (row < rows)).ravel()[order]]
    back = np.zeros_like(shift)
    back[row.ravel()[order], column.ravel()[order]] = -shift.reshape(-1, 2)[order]
    return back
