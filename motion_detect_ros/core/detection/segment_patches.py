"""Foreground patches of one segment of clustered cells: connected pixels that touch it, near their peak gain."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from motion_detect_ros.core.config import ObjectsConfig
from motion_detect_ros.core.detection.patches import Patch, connected_pixels, join_patches
from motion_detect_ros.core.detection.photometric import PhotometricTests
from motion_detect_ros.core.detection.segments import Segment, cells_of_all
from motion_detect_ros.core.geometry.boxes import Box
from motion_detect_ros.core.geometry.order_statistics import percentile
from motion_detect_ros.core.kernels import kernel
from motion_detect_ros.core.threads import HELPERS

#: Fewer foreground pixels than this are noise.
MIN_PIXELS = 8
#: The gain that a patch's strongest pixels reach, as a percentile.
PEAK_PERCENTILE = 90.0


@dataclass(frozen=True)
class CellEdges:
    """Pixels at which the cells of a grid over an image begin, and the last ones end: ``rows`` (gh + 1,), ``columns``
    (gw + 1,).
    """

    rows: npt.NDArray[np.int64]
    columns: npt.NDArray[np.int64]

    @classmethod
    def of(cls, grid: tuple[int, ...], size: tuple[int, ...]) -> CellEdges:
        """grid: rows and columns of cells; size: height and width of the image."""
        rows, columns = (-(-np.arange(cells + 1) * pixels // cells) for cells, pixels in zip(grid, size, strict=True))
        return cls(rows, columns)


class JoinLimits(NamedTuple):
    """Areas that ``join_patches`` asks for, square pixels."""

    least_area: float = math.inf
    most_area: float = math.inf
    near_area: float = math.inf


def segment_patches(
    tests: PhotometricTests, segments: Sequence[Segment], edges: CellEdges, config: ObjectsConfig, limits: JoinLimits,
    parts: int = 1,
) -> list[list[Patch]]:
    """Patches of objects that touch each segment, pixels of the test of its region; those of one object are joined.

    They are cut down to the pixels near their strongest gain: a soft shadow moves with its object, but its gain is far
    below that of the object's own edges. parts: threads.
    """
    labels, counts = np.empty(tests.starts[-1], np.int32), np.empty(len(tests), np.int64)
    there = np.split(labels, tests.starts[1:-1])

    def connect(first: int) -> None:
        for n in range(first, len(tests), parts):
            mask = tests[n].foreground
            counts[n], _ = connected_pixels(mask, config.closing_px, there[n].reshape(mask.shape))

    HELPERS.share(connect, range(parts))
    of_each = np.concatenate([[0], np.cumsum(counts)])
    patches, left = np.zeros((of_each[-1], 5), np.int64), np.empty(len(tests), np.int64)
    largest, most = int(np.diff(tests.starts).max()), int(counts.max())
    cells = cells_of_all(segments)

    def fill(first: int) -> None:
        _fill_patches(labels, tests.foreground, tests.gain, tests.boxes, tests.starts, *cells, edges.rows,
                      edges.columns, np.float32(config.peak_share), first, parts, of_each,
                      np.empty((3, largest), np.int32), np.empty((2, most + 1), np.int64),
                      np.empty(largest, np.float32), np.empty(most, np.bool_), np.empty(most, np.float32), patches,
                      left)

    HELPERS.share(fill, range(parts))
    join_patches(patches, of_each, *limits, np.empty((most, 5), np.int64), left)
    return [[Patch(Box(*row[:4]), row[4]) for row in patches[start:start + count].tolist()]
            for start, count in zip(of_each.tolist(), left.tolist(), strict=False)]


@kernel()
def _fill_patches(  # type: ignore[no-untyped-def]
    labels, masks, gains, boxes, starts, cell_rows, cell_columns, cell_starts, row_edges, column_edges, peak_share,
    first, step, of_each, places, label_starts, ordered, touches, limits, patches, left,
):
    """``patches``: (., 5) left, top, right, bottom, number of the pixels near the peak gain of each label, of every
    ``step``-th segment from ``of_each``, (n + 1,), on; only those that touch its cells, and are not too small, ``left``
    (n,) in number.

    labels, masks, gains: (.,) of regions (n, 4), which begin at ``starts``; cells: (.,), those of each segment begin at
    ``cell_starts``, on a grid whose cells begin and end at the edges (gh + 1,), (gw + 1,). Scratch for the largest
    region and most labels: places: (3, .) int32, ordered: (.,); label_starts: (2, . + 1), touches, limits: (.,).
    """
    for n in range(first, len(boxes), step):
        west, north, columns = boxes[n, 0], boxes[n, 1], boxes[n, 2] - boxes[n, 0]
        rows, start, count = boxes[n, 3] - boxes[n, 1], starts[n], of_each[n + 1] - of_each[n]
        own = patches[of_each[n]:of_each[n + 1]]
        number = _gather(labels, masks, gains, start, rows, columns, count, places, label_starts, ordered)
        for label in range(count):
            touches[label], limits[label], own[label, 0], own[label, 1] = False, np.inf, columns, rows
        for m in range(cell_starts[n], cell_starts[n + 1]):
            r, c = cell_rows[m], cell_columns[m]
            _note_touched(labels, masks, start, columns, max(0, row_edges[r] - north),
                          min(rows, row_edges[r + 1] - north), max(0, column_edges[c] - west),
                          min(columns, column_edges[c + 1] - west), touches)
        for label in range(count):
            if touches[label] and label_starts[0, label + 1] - label_starts[0, label] >= MIN_PIXELS:
                limits[label] = peak_share * percentile(
                    ordered[label_starts[0, label]:label_starts[0, label + 1]], PEAK_PERCENTILE)
        for m in range(number):
            y, x, label = places[0, m], places[1, m], places[2, m]
            if gains[start + y * columns + x] > limits[label]:
                own[label, 0], own[label, 1] = min(own[label, 0], x), min(own[label, 1], y)
                own[label, 2], own[label, 3] = max(own[label, 2], x + 1), y + 1
                own[label, 4] += 1
        left[n] = 0
        for label in range(count):
            if own[label, 4] >= MIN_PIXELS:
                for side in range(5):  # an assignment of slices takes seconds to compile
                    own[left[n], side] = own[label, side]
                left[n] += 1


@kernel()
def _gather(labels, masks, gains, start, rows, columns, count, places, starts, ordered):  # type: ignore[no-untyped-def]
    """``places``: row, column and label of each pixel of a mask, in raster order; returns their number. ``ordered``:
    gains of the pixels of label after label, which begin at ``starts[0]``.
    """
    number = 0
    for label in range(count + 1):
        starts[0, label] = 0
    for y in range(rows):
        for x in range(columns):
            if masks[start + y * columns + x]:
                label = labels[start + y * columns + x]
                places[0, number], places[1, number], places[2, number] = y, x, label
                number += 1
                starts[0, label + 1] += 1
    for label in range(count):
        starts[0, label + 1] += starts[0, label]
        starts[1, label] = starts[0, label]
    for m in range(number):
        label = places[2, m]
        ordered[starts[1, label]] = gains[start + places[0, m] * columns + places[1, m]]
        starts[1, label] += 1
    return number


@kernel()
def _note_touched(labels, masks, start, columns, top, bottom, left, right, touches):  # type: ignore[no-untyped-def]
    """``touches``: True at the labels of pixels of a mask in a window; what is of its region begins at ``start``."""
    for y in range(top, bottom):
        for n in range(start + y * columns + left, start + y * columns + right):
            if masks[n]:
                touches[labels[n]] = True
