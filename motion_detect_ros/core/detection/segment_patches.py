"""Foreground patches of one segment of clustered cells: connected pixels that touch it, near their peak gain."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from motion_detect_ros.core.config import ObjectsConfig
from motion_detect_ros.core.detection.patches import Patch, connected_pixels
from motion_detect_ros.core.detection.photometric import PhotometricTest
from motion_detect_ros.core.detection.segments import Segment
from motion_detect_ros.core.geometry.boxes import Box
from motion_detect_ros.core.geometry.order_statistics import percentile
from motion_detect_ros.core.kernels import kernel

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


def strong_patches(
    test: PhotometricTest, region: Box, segment: Segment, edges: CellEdges, config: ObjectsConfig,
) -> list[Patch]:
    """Patches that touch a segment, cut down to the pixels near their strongest gain, pixels of the test's region.

    A soft shadow moves with its object, but its gain is far below that of the object's own edges.
    """
    count, labels = connected_pixels(test.foreground, config.closing_px)
    patches = np.zeros((count, 5), np.int64)
    _fill_patches(labels, test.foreground, test.gain, segment.rows, segment.columns, edges.rows, edges.columns,
                  region.left, region.top, np.float32(config.peak_share), np.empty((2, labels.size), np.int32),
                  np.zeros((2, count + 1), np.int64), np.empty(labels.size, np.float32), np.zeros(count, np.bool_),
                  np.empty(count, np.float32), patches)
    return [Patch(Box(*row[:4]), row[4]) for row in patches.tolist() if row[4] >= MIN_PIXELS]


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
