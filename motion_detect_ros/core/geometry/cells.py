"""Points in the cells of a grid: thinned to one in each, or near others."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from motion_detect_ros.core.kernels import kernel
from motion_detect_ros.core.types import BoolArray, FloatArray

Indices = npt.NDArray[np.intp]


def first_of_cells(
    points: FloatArray, cell_px: float, width: int, height: int, order: Indices | None = None,
) -> Indices:
    """Indices, ascending, of the first point of each square cell of ``cell_px`` of an image.

    points: (N, 2) pixels on the image; order: (N,) in which they come, None = as they are.
    """
    columns, rows = int(width / cell_px) + 1, int(height / cell_px) + 1
    taken, first = np.zeros(rows * columns, np.bool_), np.zeros(len(points), np.bool_)
    order = np.arange(len(points)) if order is None else order
    _first(np.ascontiguousarray(points), 1.0 / cell_px, columns, order, taken, first)
    return np.flatnonzero(first)


@kernel()
def _first(points, scale, columns, order, taken, first):  # type: ignore[no-untyped-def]
    for index in order:
        cell = int(points[index, 1] * scale) * columns + int(points[index, 0] * scale)
        first[index] = not taken[cell]
        taken[cell] = True


def near_others(points: FloatArray, others: FloatArray, distance_px: float, width: int, height: int) -> BoolArray:
    """(N,) mask of the points with another one nearer than a distance. points, others: (N, 2), (m, 2) pixels on an
    image.
    """
    columns, rows = int(width / distance_px) + 1, int(height / distance_px) + 1
    newest, before = np.full((rows, columns), -1, np.intp), np.empty(len(others), np.intp)
    near = np.zeros(len(points), np.bool_)
    _near(np.ascontiguousarray(points), np.ascontiguousarray(others), distance_px, newest, before, near)
    return near


@kernel()
def _near(points, others, distance_px, newest, before, near):  # type: ignore[no-untyped-def]
    """newest: (rows, columns) of -1, before: (m,) scratch: the others of a cell, a list from its newest on."""
    rows, columns = newest.shape
    for index in range(len(others)):
        row, column = int(others[index, 1] / distance_px), int(others[index, 0] / distance_px)
        before[index], newest[row, column] = newest[row, column], index
    for index in range(len(points)):
        x, y = float(points[index, 0]), float(points[index, 1])
        row, column = int(y / distance_px), int(x / distance_px)
        for r in range(max(0, row - 1), min(rows, row + 2)):
            for c in range(max(0, column - 1), min(columns, column + 2)):
                other = newest[r, c]
                while other >= 0 and not near[index]:
                    near[index] = (others[other, 0] - x) ** 2 + (others[other, 1] - y) ** 2 < distance_px ** 2
                    other = before[other]
