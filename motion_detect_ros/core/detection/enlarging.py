"""Motion on a coarse grid, enlarged to the pixels of an image, row by row."""

from __future__ import annotations

import numpy as np

from motion_detect_ros.core.kernels import kernel


@kernel(error_model='numpy')
def find_columns(left, columns, width, count, west, share):  # type: ignore[no-untyped-def]
    """``west``: (.,) uint32 cell left of the centre of ``count`` pixels each; ``share``: (.,) of the way to the next.

    They are those from ``left`` on of a row of ``width`` pixels with this many cells over it.
    """
    cells_a_pixel, half, last = np.float32(columns / width), np.float32(0.5), np.float32(columns - 1)
    for x in range(count):
        place = min(max((np.float32(left + x) + half) * cells_a_pixel - half, np.float32(0.0)), last)
        cell = np.int32(place)
        west[x], share[x] = np.uint32(cell), place - np.float32(cell)


@kernel(error_model='numpy')
def enlarge_row(flow, row, height, count, west, share, above, lines, line):  # type: ignore[no-untyped-def]
    """``line``: (2, .) x and y of ``count`` pixels of a row of an image of this height, linear between the cells (gh,
    gw, 2) of a grid over it; returns the row of cells above, -1 before the first call.

    Between the outermost cells' centres and the image border the outermost cells are replicated. west, share: (.,) of
    ``find_columns``; lines: (4, .), the rows of cells above and below, which many rows of the image share: made already
    where ``above`` is what the row before has returned.
    """
    rows, half = len(flow), np.float32(0.5)
    place = min(max((np.float32(row) + half) * np.float32(rows / height) - half, np.float32(0.0)), np.float32(rows - 1))
    north = int(place)
    for r in range(north, min(north + 2, rows)):
        if above == north or (r == north and above >= 0 and above == north - 1):
            continue
        for axis in range(2):
            for x in range(count):
                here, last = flow[r, west[x], axis], flow.shape[1] - 1
                lines[2 * (r % 2) + axis, x] = here + share[x] * (flow[r, min(west[x] + 1, last), axis] - here)
    down, high = place - np.float32(north), 2 * (north % 2)
    low = 2 * ((north + 1) % 2) if north + 1 < rows else high
    for axis in range(2):
        for x in range(count):
            line[axis, x] = lines[high + axis, x] + down * (lines[low + axis, x] - lines[high + axis, x])
    return north
