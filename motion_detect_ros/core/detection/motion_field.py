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

#: Margin around an object in which the share of known flow is measured, cells.
AROUND_CELLS = 4


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
        flow: FloatArray = _enlarged(self.background.flow, region.left, region.top, region.right, region.bottom,
                                     width, height, np.float32(self.scale))
        return flow

    def motion_of(self, segment: Segment) -> FloatArray:
        """(2,) median motion of a segment beyond the ego-motion, working-resolution pixels."""
        motion: FloatArray = _median_motion(self.residual, segment.rows, segment.columns)
        return motion * np.float32(self.scale)

    @cached_property
    def object_flow(self) -> FloatArray:
        """(gh, gw, 2) motion against the background, full-resolution pixels, NaN = unknown."""
        flow: FloatArray = self.residual - self.background.flow
        return flow

    def object_motion_of(self, segment: Segment) -> FloatArray:
        """(2,) median motion of a segment against the background, working-resolution pixels."""
        motion: FloatArray = _median_motion(self.object_flow, segment.rows, segment.columns)
        return motion * np.float32(self.scale)

    def object_motion(self, rows: slice, columns: slice) -> tuple[FloatArray, float, float]:
        """Motion against the background in a window of cells: (2,) pixels, in noise units, share of known cells.

        The median of the faster half of the cells; the slower half is smeared background.
        """
        motion, known, sigma_px = _object_motion(self.residual, self.background.flow, self.background.sigma_px,
                                              rows.start, rows.stop, columns.start, columns.stop)
        length = float(np.hypot(motion[0], motion[1]))
        return motion, length / sigma_px if known else 0.0, known

    def known_around(self, rows: slice, columns: slice) -> float:
        """Share of the cells within ``AROUND_CELLS`` of a window of cells, but not in it, whose motion is known."""
        return float(_known_around(self.residual, rows.start, rows.stop, columns.start, columns.stop))


@kernel(error_model='numpy')
def _enlarged(flow, left, top, right, bottom, width, height, scale):  # type: ignore[no-untyped-def]
    """(bottom - top, right - left, 2) pixels of a grid over a ``width`` x ``height`` image, linear, times ``scale``.

    Between the outermost cells' centres and the image border the outermost cells are replicated.
    """
    rows, columns = flow.shape[:2]
    enlarged = np.empty((bottom - top, right - left, 2), np.float32)
    across, down, half = np.float32(columns / width), np.float32(rows / height), np.float32(0.5)
    for y in range(top, bottom):
        r = min(max((np.float32(y) + half) * down - half, np.float32(0.0)), np.float32(rows - 1))
        above = int(r)
        below, v = min(above + 1, rows - 1), r - np.float32(above)
        for x in range(left, right):
            c = min(max((np.float32(x) + half) * across - half, np.float32(0.0)), np.float32(columns - 1))
            west = int(c)
            east, u = min(west + 1, columns - 1), c - np.float32(west)
            for axis in range(2):
                high = flow[above, west, axis] + u * (flow[above, east, axis] - flow[above, west, axis])
                low = flow[below, west, axis] + u * (flow[below, east, axis] - flow[below, west, axis])
                enlarged[y - top, x - left, axis] = (high + v * (low - high)) * scale
    return enlarged


@kernel()
def _median_motion(residual, rows, columns):  # type: ignore[no-untyped-def]
    """(2,) median of the cells (n,)."""
    cells = np.empty((2, len(rows)), np.float32)
    for n in range(len(rows)):
        cells[0, n], cells[1, n] = residual[rows[n], columns[n], 0], residual[rows[n], columns[n], 1]
    motion = np.empty(2, np.float32)
    motion[0], motion[1] = median(cells[0]), median(cells[1])
    return motion


@kernel()
def _object_motion(residual, flow, sigma_px, top, bottom, left, right):  # type: ignore[no-untyped-def]
    """(2,) median of the faster half of the known cells of a window, their share, and their median noise."""
    area = (bottom - top) * (right - left)
    object_flow = np.empty((2, area), np.float32)
    length, noise = np.empty(area, np.float32), np.empty(area, np.float32)
    count = 0
    for r in range(top, bottom):
        for c in range(left, right):
            x, y = residual[r, c, 0] - flow[r, c, 0], residual[r, c, 1] - flow[r, c, 1]
            if np.isfinite(x):
                object_flow[0, count], object_flow[1, count], length[count] = x, y, np.hypot(x, y)
                noise[count] = sigma_px[r, c]
                count += 1
    motion = np.zeros(2, np.float32)
    if count == 0:
        return motion, 0.0, 0.0
    limit = median(length[:count])
    fast = 0
    for n in range(count):
        if length[n] >= limit:
            object_flow[0, fast], object_flow[1, fast] = object_flow[0, n], object_flow[1, n]
            fast += 1
    motion[0], motion[1] = median(object_flow[0, :fast]), median(object_flow[1, :fast])
    return motion, count / area, float(median(noise[:count]))


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
