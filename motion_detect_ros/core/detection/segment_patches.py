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

    def every(first: int) -> None:
        _fill_all_patches(labels, tests.foreground, tests.gain, tests.boxes, tests.starts, *cells, edges.rows,
                          edges.columns, np.float32(config.peak_share), *limits, first, parts, of_each,
                          np.empty((2, largest), np.int32), np.empty((2, most + 1), np.int64),
                          np.empty(largest, np.float32), np.empty(most, np.bool_), np.empty(most, np.float32),
                          np.empty((most, 5), np.int64), patches, left)

    HELPERS.share(every, range(parts))
    return [[Patch(Box(*row[:4]), row[4]) for row in patches[start:start + count].tolist()]
            for start, count in zip(of_each.tolist(), left.tolist(), strict=False)]


@kernel()
def _fill_all_patches(  # type: ignore[no-untyped-def]
    labels, masks, gains, boxes, starts, cell_rows, cell_columns, cell_starts, row_edges, column_edges, peak_share,
    least_area, most_area, near_area, first, step, of_each, places, label_starts, ordered, touches, limits, done,
    patches, left,
):
    """``patches``: (., 5), those of every ``step``-th segment from ``of_each``, (n + 1,), on; ``left``: (n,) their
    numbers. labels, masks, gains: (.,) of regions (n, 4), which begin at ``starts``; scratch as ``_fill_patches`` and
    ``join_patches``, for the largest.
    """
    for n in range(first, len(boxes), step):
        shape = boxes[n, 3] - boxes[n, 1], boxes[n, 2] - boxes[n, 0]
        start, end, count = starts[n], starts[n + 1], of_each[n + 1] - of_each[n]
        own = patches[of_each[n]:of_each[n + 1]]
        label_starts[:], touches[:] = 0, False
        _fill_patches(labels[start:end].reshape(shape), masks[start:end].reshape(shape),
                      gains[start:end].reshape(shape), cell_rows[cell_starts[n]:cell_starts[n + 1]],
                      cell_columns[cell_starts[n]:cell_starts[n + 1]], row_edges, column_edges, boxes[n, 0],
                      boxes[n, 1], peak_share, places, label_starts[:, :count + 1], ordered, touches[:count],
                      limits[:count], own)
        kept = 0
        for label in range(count):
            if own[label, 4] >= MIN_PIXELS:
                own[kept] = own[label]
                kept += 1
        left[n] = join_patches(own[:kept], least_area, most_area, near_area, done)


@kernel()
def _fill_patches(  # type: ignore[no-untyped-def]
    labels, mask, gain, cell_rows, cell_columns, row_edges, column_edges, left, top, peak_share, places, starts, gains,
    touches, limits, patches,
):
    """``patches``: (count, 5) left, top, right, bottom, number of the pixels near the peak gain of each label; number 0
    where the label does not touch the cells (n,) of a grid, which begin and end at ``row_edges`` (gh + 1,) and
    ``column_edges`` (gw + 1,), or is too small.

    labels, mask, gain: (h, w), at left, top of it; scratch: places: (2, h * w) int32; starts: (2, count + 1) zeros,
    where the pixels of each label begin in ``gains`` (h * w,), and are filled so far; touches: (count,) False; limits:
    (count,).
    """
    rows, columns = labels.shape
    number = _gather(labels, mask, gain, places, starts[0], starts[1], gains)
    for n in range(len(cell_rows)):
        r, c = cell_rows[n], cell_columns[n]
        _note_touched(labels, mask, max(0, row_edges[r] - top), min(rows, row_edges[r + 1] - top),
                      max(0, column_edges[c] - left), min(columns, column_edges[c + 1] - left), touches)
    for label in range(len(limits)):
        start, end = starts[0, label], starts[0, label + 1]
        limits[label], patches[label, 0], patches[label, 1] = np.inf, columns, rows
        if touches[label] and end - start >= MIN_PIXELS:
            limits[label] = peak_share * percentile(gains[start:end], PEAK_PERCENTILE)
    for n in range(number):
        y, x = places[0, n], places[1, n]
        label = labels[y, x]
        if gain[y, x] > limits[label]:
            patch = patches[label]
            patch[0], patch[1], patch[2], patch[3] = min(patch[0], x), min(patch[1], y), max(patch[2], x + 1), y + 1
            patch[4] += 1


@kernel()
def _gather(labels, mask, gain, places, starts, filled, gains):  # type: ignore[no-untyped-def]
    """``places``: row and column of each pixel of ``mask``, in raster order; returns their number. ``gains``: of the
    pixels of label after label, which begin at ``starts``, (count + 1,) zeros like ``filled``.
    """
    rows, columns = labels.shape
    number = 0
    for y in range(rows):
        for x in range(columns):
            if mask[y, x]:
                places[0, number], places[1, number] = y, x
                number += 1
                starts[labels[y, x] + 1] += 1
    for label in range(len(starts) - 1):
        starts[label + 1] += starts[label]
        filled[label] = starts[label]
    for n in range(number):
        label = labels[places[0, n], places[1, n]]
        gains[filled[label]] = gain[places[0, n], places[1, n]]
        filled[label] += 1
    return number


@kernel()
def _note_touched(labels, mask, top, bottom, left, right, touches):  # type: ignore[no-untyped-def]
    """``touches``: True at the labels of pixels in a window."""
    for y in range(top, bottom):
        for x in range(left, right):
            if mask[y, x]:
                touches[labels[y, x]] = True
