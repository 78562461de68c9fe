"""Motion on a coarse grid, enlarged to the pixels of an image, row by row."""

from __future__ import annotations

import numpy as np

from motion_detect_ros.core.kernels import kernel


@kernel(error_model='numpy')
def find_columns(left, columns, width, west, share):  # type: ignore[no-untyped-def]
    """``west``: (w,) uint32 cell whose centre is left of each pixel from ``left`` on of a row of ``width`` pixels with
    this many cells over it, ``share``: (w,) of the way to the next one.
    """
    cells_a_pixel = np.float32(columns / width)
    for x in range(len(west)):
        place = _place(left + x, cells_a_pixel, columns)
        cell = np.int32(place)
        west[x], share[x] = np.uint32(cell), place - np.float32(cell)


@kernel(error_model='numpy')
def enlarge_row(flow, row, height, west, share, above, lines, line):  # type: ignore[no-untyped-def]
    """``line``: (2, w) x and y in a row of an image of this height, linear between the cells (gh, gw, 2) of a grid over
    it; returns the row of cells above, -1 before the first call.

    Between the outermost cells' centres and the image border the outermost cells are replicated. west, share: (w,) of
    ``find_columns``; lines: (4, w), the rows of cells above and below, which many rows of the image share: made already
    where ``above`` is what the row before has returned.
    """
    rows = len(flow)
    place = _place(row, np.float32(rows / height), rows)
    north = int(place)
    if above != north:
        if above != north - 1 or above < 0:
            _stretch(flow[north], west, share, lines[2 * (north % 2):])
        if north + 1 < rows:
            _stretch(flow[north + 1], west, share, lines[2 * ((north + 1) % 2):])
    down = place - np.float32(north)
    for axis in range(2):
        values, high = line[axis], lines[2 * (north % 2) + axis]
        low = lines[2 * ((north + 1) % 2) + axis] if north + 1 < rows else high
        for x in range(len(west)):
            values[x] = high[x] + down * (low[x] - high[x])
    return north


@kernel()
def _stretch(cells, west, share, line):  # type: ignore[no-untyped-def]
    """First rows of ``line``, (., w): x and y between cells (n, 2)."""
    last = len(cells) - 1
    for axis in range(2):
        values = line[axis]
        for x in range(len(west)):
            here, next_one = cells[west[x], axis], cells[min(west[x] + 1, last), axis]
            values[x] = here + share[x] * (next_one - here)


@kernel()
def _place(pixel, cells_a_pixel, cells):  # type: ignore[no-untyped-def]
    """Where the centre of a pixel is, counted in the centres of this many cells."""
    half = np.float32(0.5)
    return min(max((np.float32(pixel) + half) * cells_a_pixel - half, np.float32(0.0)), np.float32(cells - 1))
