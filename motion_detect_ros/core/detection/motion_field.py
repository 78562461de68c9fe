"""Motion on the grid of one frame: background flow, object flow, and where they are known."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from motion_detect_ros.core.background.planar import Background
from motion_detect_ros.core.detection.segments import Segment
from motion_detect_ros.core.geometry.boxes import Box
from motion_detect_ros.core.geometry.order_statistics import median
from motion_detect_ros.core.kernels import kernel
from motion_detect_ros.core.types import FloatArray

#: Margin around an object in which the share of known flow is measured, cells: wider than what even fast objects
#: uncover from frame to frame, which says nothing against them.
AROUND_CELLS = 12


@dataclass(frozen=True)
class MotionField:
    """Motion on the grid of one frame.

    ``residual``: (gh, gw, 2) motion beyond the ego-motion, full-resolution pixels over ``seconds``, NaN = unknown;
    ``background``: its background flow; ``scale``: working / full resolution.
    """

    residual: FloatArray
    background: Background
    seconds: float
    scale: float

    def background_flow(self, region: Box, width: int, height: int) -> FloatArray:
        """(h, w, 2) motion of the background in a region of the ``width`` x ``height`` working image, its pixels."""
        flow = np.empty((region.height, region.width, 2), np.float32)
        _enlarge(self.background.flow, region.left, region.top, width, height, np.float32(self.scale),
                 np.empty((2, 2 * region.width), np.float32), flow.reshape(region.height, -1))
        return flow

    @cached_property
    def object_flow(self) -> FloatArray:
        """(gh, gw, 2) motion against the background, full-resolution pixels, NaN = unknown."""
        flow: FloatArray = self.residual - self.background.flow
        return flow

    def motions_of(self, segment: Segment) -> tuple[FloatArray, FloatArray]:
        """Median motion of a segment beyond the ego-motion, and against the background, (2,) working pixels each."""
        motions, cells = np.empty((2, 2), np.float32), np.empty((4, len(segment.rows)), np.float32)
        _median_motions(self.residual, self.background.flow, segment.rows, segment.columns, cells, motions)
        motions *= np.float32(self.scale)
        return motions[0], motions[1]

    def object_motion(self, rows: slice, columns: slice) -> tuple[FloatArray, float, float]:
        """Motion against the background in a window of cells: (2,) pixels, in noise units, share of known cells.

        The median of the faster half of the cells; the slower half is smeared background.
        """
        motion = np.zeros(2, np.float32)
        cells = np.empty((5, (rows.stop - rows.start) * (columns.stop - columns.start)), np.float32)
        known, sigma_px = _object_motion(self.residual, self.background.flow, self.background.sigma_px,
                                         rows.start, rows.stop, columns.start, columns.stop, cells, motion)
        length = float(np.hypot(motion[0], motion[1]))
        return motion, length / sigma_px if known else 0.0, known

    def known_around(self, rows: slice, columns: slice) -> float:
        """Share of the cells within ``AROUND_CELLS`` of a window of cells, but not in it, whose motion is known."""
        return float(_known_around(self.residual, rows.start, rows.stop, columns.start, columns.stop))


@kernel(error_model='numpy')
def _enlarge(flow, left, top, width, height, scale, lines, enlarged):  # type: ignore[no-untyped-def]
    """``enlarged``: (h, w * 2) at left, top of a grid over a ``width`` x ``height`` image, linear, times ``scale``.

    Between the outermost cells' centres and the image border the outermost cells are replicated. lines: (2, w * 2), of
    the rows of the grid above and below, which many rows of the image share.
    """
    rows = flow.shape[0]
    down, half, above = np.float32(rows / height), np.float32(0.5), -1
    for y in range(enlarged.shape[0]):
        r = min(max((np.float32(top + y) + half) * down - half, np.float32(0.0)), np.float32(rows - 1))
        if above != int(r):
            above = int(r)
            _stretch(flow[above], left, width, lines[0])
            _stretch(flow[min(above + 1, rows - 1)], left, width, lines[1])
        v, high, low, line = r - np.float32(above), lines[0], lines[1], enlarged[y]
        for n in range(len(line)):
            line[n] = (high[n] + v * (low[n] - high[n])) * scale


@kernel(error_model='numpy')
def _stretch(cells, left, width, line):  # type: ignore[no-untyped-def]
    """``line``: (w * 2,) from ``left`` on of cells (n, 2) over an image of this width, linear."""
    columns = len(cells)
    across, half = np.float32(columns / width), np.float32(0.5)
    for x in range(len(line) // 2):
        c = min(max((np.float32(left + x) + half) * across - half, np.float32(0.0)), np.float32(columns - 1))
        west = int(c)
        east, u = min(west + 1, columns - 1), c - np.float32(west)
        for axis in range(2):
            line[2 * x + axis] = cells[west, axis] + u * (cells[east, axis] - cells[west, axis])


@kernel()
def _median_motions(residual, flow, rows, columns, cells, motions):  # type: ignore[no-untyped-def]
    """``motions``: (2, 2) median over the cells (n,) of the residual, and of what is left of it beyond the background's
    flow; cells: (4, n).
    """
    for n in range(len(rows)):
        for axis in range(2):
            own = residual[rows[n], columns[n], axis]
            cells[axis, n], cells[2 + axis, n] = own, own - flow[rows[n], columns[n], axis]
    for which in range(4):
        motions[which // 2, which % 2] = median(cells[which])


@kernel()
def _object_motion(residual, flow, sigma_px, top, bottom, left, right, cells, motion):  # type: ignore[no-untyped-def]
    """``motion``: (2,) zeros, then the median of the faster half of the known cells of a window. Returns the share that
    is known, and the median noise of those. cells: (5, n) for the n cells of the window.
    """
    object_x, object_y, length, ordered, noise = cells[0], cells[1], cells[2], cells[3], cells[4]
    count = 0
    for r in range(top, bottom):
        for c in range(left, right):
            x, y = residual[r, c, 0] - flow[r, c, 0], residual[r, c, 1] - flow[r, c, 1]
            if np.isfinite(x):
                object_x[count], object_y[count], noise[count] = x, y, sigma_px[r, c]
                length[count] = ordered[count] = np.hypot(x, y)
                count += 1
    if count == 0:
        return 0.0, 0.0
    limit = median(ordered[:count])
    fast = 0
    for n in range(count):
        if length[n] >= limit:
            object_x[fast], object_y[fast] = object_x[n], object_y[n]
            fast += 1
    motion[0], motion[1] = median(object_x[:fast]), median(object_y[:fast])
    return count / len(noise), float(median(noise[:count]))


@kernel()
def _known_around(residual, top, bottom, left, right):  # type: ignore[no-untyped-def]
    """Share of known cells in the frame of ``AROUND_CELLS`` around a window, cut at the grid's edges."""
    rows, columns = residual.shape[:2]
    known = cells = 0
    for r in range(max(0, top - AROUND_CELLS), min(rows, bottom + AROUND_CELLS)):
        for c in range(max(0, left - AROUND_CELLS), min(columns, right + AROUND_CELLS)):
            if top <= r < bottom and left <= c < right:
                continue
            cells += 1
            known += np.isfinite(residual[r, c, 0])
    return known / max(1, cells)
