"""Points thinned to one in each cell of a grid."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from motion_detect_ros.core.kernels import kernel
from motion_detect_ros.core.types import FloatArray

Indices = npt.NDArray[np.intp]


def first_of_cells(
    points: FloatArray, cell_px: float, width: int, height: int, order: Indices | None = None,
) -> Indices:
    """Indices, ascending, of the first point of each square cell of ``cell_px`` of an image.

    points: (N, 2) pixels on the image; order: (N,) in which they come, None = as they are.
    """
    columns, rows = int(width / cell_px) + 1, int(height / cell_px) + 1
    first = np.full(rows * columns, -1, np.intp)
    order = np.arange(len(points)) if order is None else order
    _first(np.ascontiguousarray(points), 1.0 / cell_px, columns, order, first)
    return np.sort(first[first >= 0])


@kernel()
def _first(points, scale, columns, order, first):  # type: ignore[no-untyped-def]
    for index in order:
        cell = int(points[index, 1] * scale) * columns + int(points[index, 0] * scale)
        if first[cell] < 0:
            first[cell] = index
