"""Motion on the grid of one frame: background flow, object flow, and where they are known."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import cv2
import numpy as np
import numpy.typing as npt

from motion_detect_ros.core.background.planar import Background
from motion_detect_ros.core.detection.segments import Segment, cells_of_all
from motion_detect_ros.core.geometry.order_statistics import median
from motion_detect_ros.core.geometry.vectors import magnitude
from motion_detect_ros.core.kernels import kernel
from motion_detect_ros.core.types import DoubleArray, FloatArray

#: (n, 4) top, bottom, left, right of windows of cells; bottom and right are exclusive.
Windows = npt.NDArray[np.int64]
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

    @cached_property
    def object_flow(self) -> FloatArray:
        """(gh, gw, 2) motion against the background, full-resolution pixels, NaN = unknown."""
        flow: FloatArray = self.residual - self.background.flow
        return flow

    def motions_of(self, segments: Sequence[Segment]) -> FloatArray:
        """(n, 2, 2) median motions of segments beyond the ego-motion, and against the background, working pixels."""
        rows, columns, starts = cells_of_all(segments)
        motions = np.empty((len(segments), 4), np.float32)
        _median_motions(self.residual, self.background.flow, rows, columns, starts,
                        np.empty((4, starts[-1]), np.float32), motions)
        return (motions * np.float32(self.scale)).reshape(-1, 2, 2)

    def object_motions(self, windows: Windows) -> tuple[FloatArray, DoubleArray, DoubleArray]:
        """Motion against the background in windows of cells: (n, 2) pixels, (n,) in noise units, (n,) share of known
        cells.

        The median of the faster half of the cells; the slower half is smeared background.
        """
        motions, figures = np.zeros((len(windows), 2), np.float32), np.zeros((2, len(windows)))
        most = int(_areas(windows).max(initial=0))
        _fill_object_motions(self.residual, self.background.flow, self.background.sigma_px, windows,
                             np.empty((5, most), np.float32), motions, figures)
        known, sigma_px = figures
        return motions, magnitude(motions) / np.where(known > 0.0, sigma_px, 1.0), known

    def known_around(self, windows: Windows) -> DoubleArray:
        """(n,) share of known cells within ``AROUND_CELLS`` of windows of cells, but not in them."""
        (rows, columns), counts = self.residual.shape[:2], self._known_before
        around = np.stack([np.maximum(windows[:, 0] - AROUND_CELLS, 0), np.minimum(windows[:, 1] + AROUND_CELLS, rows),
                           np.maximum(windows[:, 2] - AROUND_CELLS, 0),
                           np.minimum(windows[:, 3] + AROUND_CELLS, columns)], axis=1)
        outer, inner = (counts[each[:, 1], each[:, 3]] - counts[each[:, 0], each[:, 3]] - counts[each[:, 1], each[:, 2]]
                        + counts[each[:, 0], each[:, 2]] for each in (around, windows))
        share: DoubleArray = (outer - inner) / np.maximum(1, _areas(around) - _areas(windows))
        return share

    @cached_property
    def _known_before(self) -> npt.NDArray[np.int32]:
        """(gh + 1, gw + 1) number of known cells above and left of each corner."""
        return cv2.integral(np.isfinite(self.residual[..., 0]).view(np.uint8))


def cells_of(boxes: npt.NDArray[np.int64], grid: tuple[int, ...], size: tuple[int, ...]) -> Windows:
    """(n, 4) windows of cells that hold boxes (n, 4) left, top, right, bottom, pixels of an image of this height and
    width; grid: rows and columns of cells over it.
    """
    (rows, columns), (height, width) = grid, size
    left, top, right, bottom = boxes.T
    return np.stack([top * rows // height, -(-bottom * rows // height), left * columns // width,
                     -(-right * columns // width)], axis=1)


def _areas(windows: Windows) -> npt.NDArray[np.int64]:
    """(n,) cells."""
    return (windows[:, 1] - windows[:, 0]) * (windows[:, 3] - windows[:, 2])


@kernel()
def _median_motions(residual, flow, rows, columns, starts, cells, motions):  # type: ignore[no-untyped-def]
    """``motions``: (n, 4) median over the cells of each segment, which begin at ``starts`` (n + 1,), of the residual,
    and of what is left of it beyond the background's flow; cells: (4, .) for all of them.
    """
    for number in range(len(motions)):
        start, end = starts[number], starts[number + 1]
        for n in range(start, end):
            for axis in range(2):
                own = residual[rows[n], columns[n], axis]
                cells[axis, n], cells[2 + axis, n] = own, own - flow[rows[n], columns[n], axis]
        for which in range(4):
            motions[number, which] = median(cells[which, start:end])


@kernel()
def _fill_object_motions(residual, flow, sigma_px, windows, cells, motions, figures):  # type: ignore[no-untyped-def]
    """``motions``: (n, 2) zeros, then those of ``_object_motion`` in windows (n, 4) top, bottom, left, right; figures:
    (2, n) what that returns. cells: (5, .) for the cells of the largest.
    """
    for n in range(len(windows)):
        top, bottom, left, right = windows[n]
        figures[0, n], figures[1, n] = _object_motion(residual, flow, sigma_px, top, bottom, left, right, cells,
                                                      motions[n])


@kernel()
def _object_motion(residual, flow, sigma_px, top, bottom, left, right, cells, motion):  # type: ignore[no-untyped-def]
    """``motion``: (2,) zeros, then the median of the faster half of the known cells of a window. Returns the share that
    is known, and the median noise of those. cells: (5, .) for the n cells of the window.
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
    return count / ((bottom - top) * (right - left)), float(median(noise[:count]))
