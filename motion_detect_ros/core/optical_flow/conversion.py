"""Conversion between flow of the stabilised pair, total flow (published), and residual flow without ego-motion."""

from __future__ import annotations

import numpy as np

from motion_detect_ros.core.geometry.warp import apply, grid_points, inverse
from motion_detect_ros.core.kernels import kernel
from motion_detect_ros.core.types import DoubleArray, FloatArray


def total_flow(shift: FloatArray, matrix: DoubleArray, scale: float, width: int, height: int) -> FloatArray:
    """(rows, columns, 2) displacement reference -> current, full-resolution pixels; NaN where the origin is outside.

    shift: (rows, columns, 2) displacement from the current image to the stabilised reference, working-resolution
    pixels; matrix: (3, 3) ego-motion, reference pixel -> current pixel; scale: working / full resolution.
    """
    back = inverse(matrix).astype(np.float32)
    total = np.full(shift.shape, np.nan, np.float32)
    _fill_total(np.ascontiguousarray(shift, np.float32), back, np.float32(scale), width, height, total)
    return total


def residual_flow(flow: FloatArray, matrix: DoubleArray, width: int, height: int) -> FloatArray:
    """Total flow less the ego-motion, in pixels of the later frame.

    flow: (gh, gw, 2) as in ``FlowField``; matrix: (3, 3) reference pixel -> current pixel.
    Returns (gh, gw, 2): displacement from the point's earlier position warped by the ego-motion to its position now.
    """
    points = grid_points(flow.shape[0], flow.shape[1], width, height)
    residual: FloatArray = points - apply(matrix, points - flow)
    return residual


@kernel(error_model='numpy')
def _fill_total(shift, back, scale, width, height, flow):  # type: ignore[no-untyped-def]
    """``flow``: NaN, then ``total_flow``; back: (3, 3) float32 current pixel -> reference pixel."""
    rows, columns = shift.shape[:2]
    across, down, half = np.float32(width / columns), np.float32(height / rows), np.float32(0.5)
    for r in range(rows):
        y = (np.float32(r) + half) * down - half
        for c in range(columns):
            x = (np.float32(c) + half) * across - half
            px, py = x + shift[r, c, 0] / scale, y + shift[r, c, 1] / scale
            depth = back[2, 0] * px + back[2, 1] * py + back[2, 2]
            from_x = (back[0, 0] * px + back[0, 1] * py + back[0, 2]) / depth
            from_y = (back[1, 0] * px + back[1, 1] * py + back[1, 2]) / depth
            if 0.0 <= from_x <= width - 1 and 0.0 <= from_y <= height - 1:
                flow[r, c, 0], flow[r, c, 1] = x - from_x, y - from_y
