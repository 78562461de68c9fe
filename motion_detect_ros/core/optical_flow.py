"""Dense optical flow between the current frame and an earlier one, both ways, on the stabilised pair."""

from __future__ import annotations

from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass

import cv2
import numba
import numpy as np

from motion_detect_ros.core.config import PipelineConfig
from motion_detect_ros.core.flow_backends import BUILT_IN, FlowFunction, make_flow
from motion_detect_ros.core.flow_regions import Boxes, flow_in_regions, moving_cells, regions_around
from motion_detect_ros.core.flow_search import search_fast_movers
from motion_detect_ros.core.memory import Earlier, FrameMemory
from motion_detect_ros.core.types import (
    ByteArray,
    DoubleArray,
    EgoMotion,
    FloatArray,
    FlowField,
    PreparedFrame,
)
from motion_detect_ros.core.warm_start import carried, turned_round
from motion_detect_ros.core.warp import apply, at_scale, grid_points, inverse, stabilise

#: Share of the squared lengths of both ways that their disagreement may reach (Sundaram et al. 2010, equation 5).
RETURN_SHARE = 0.01


@dataclass(frozen=True)
class _Last:
    """(rows, columns, 2) displacements found last, working pixels; frames since the whole image was looked at."""

    shift: FloatArray
    stamp_ns: int
    since_full: int


@dataclass(frozen=True)
class SecondThread:
    """Finds the way back while the caller finds the way there.

    ``flow``: the same method once more, as most keep buffers between calls; ``pool``: one worker.
    """

    flow: FlowFunction
    pool: ThreadPoolExecutor


class OpticalFlowStage:
    """Keeps the last frames; gives the flow over ``baseline_s`` seconds for each new one."""

    def __init__(self, config: PipelineConfig) -> None:
        self._config = config.optical_flow
        self._flow = make_flow(self._config)
        self._second = (SecondThread(make_flow(self._config), ThreadPoolExecutor(1, 'way_back'))
                        if self._config.method in BUILT_IN else None)
        self._memory = FrameMemory(self._config.baseline_s)
        self._last: _Last | None = None

    def reset(self) -> None:
        """Forget every earlier frame."""
        self._memory.reset()
        self._last = None

    def process(self, frame: PreparedFrame, ego: EgoMotion) -> FlowField:
        """Flow into ``frame``; all NaN where there is no earlier frame or no ego-motion to stabilise with."""
        earlier = self._memory.step(frame, ego)
        flow = self._nothing(frame) if earlier is None else self._between(earlier, frame, self._carried(frame, ego))
        return FlowField(flow, frame.width, frame.height, frame.stamp_ns)

    def _grid(self, frame: PreparedFrame) -> tuple[int, int]:
        rows, columns = frame.gray.shape
        return max(1, round(rows / self._config.grid_px)), max(1, round(columns / self._config.grid_px))

    def _nothing(self, frame: PreparedFrame) -> FloatArray:
        return np.full((*self._grid(frame), 2), np.nan, np.float32)

    def _carried(self, frame: PreparedFrame, ego: EgoMotion) -> FloatArray | None:
        """The last flow as this frame sees it, working pixels; None where no setting needs it or there is none."""
        needed = self._config.warm_start or self._config.full_every > 1
        last = self._last
        if not needed or last is None or not ego.ok or last.stamp_ns != ego.prev_stamp_ns:
            return None
        if last.shift.shape[:2] != self._grid(frame):
            return None
        return carried(last.shift, at_scale(ego.matrix, frame.scale), *frame.gray.shape[::-1])

    def _between(self, earlier: Earlier, frame: PreparedFrame, guess: FloatArray | None) -> FloatArray:
        """Total displacement on the grid: flow of the stabilised pair, put back under the ego-motion."""
        rows, columns = self._grid(frame)
        stabilised = stabilise(earlier.gray, at_scale(earlier.matrix, frame.scale))
        since_full, boxes = 0, None
        if guess is not None and self._last is not None:
            since_full = (self._last.since_full + 1) % self._config.full_every
        if guess is not None and since_full:
            boxes = regions_around(moving_cells(guess), *frame.gray.shape[::-1])
        shift = both_ways(self._flow, frame.gray, stabilised, rows, columns, self._config.forward_backward_px,
                          guess if self._config.warm_start else None, boxes,
                          self._second if cv2.getNumThreads() > 1 else None)
        if self._config.search_px:
            shift = search_fast_movers(shift, frame.gray, stabilised, self._config.search_px)
        self._last = _Last(shift, frame.stamp_ns, since_full)
        back = inverse(earlier.matrix).astype(np.float32)
        return _total(np.ascontiguousarray(shift, np.float32), back, np.float32(frame.scale), frame.width, frame.height)


def both_ways(
    flow: FlowFunction, current: ByteArray, earlier: ByteArray, rows: int, columns: int, limit_px: float,
    guess: FloatArray | None = None, boxes: Boxes | None = None, second: SecondThread | None = None,
) -> FloatArray:
    """(rows, columns, 2) displacement from ``current`` to ``earlier``, NaN where the way back does not return.

    Averaged over the cells of the grid first: most methods are no finer than that. limit_px: largest distance between
    a point and where the way there and back leads, plus a share of their lengths. guess: (rows, columns, 2) what
    to start from; boxes: (n, 4) regions as of ``flow_in_regions``, NaN outside, None = everywhere; second: what finds
    the way back at the same time, None = ``flow`` does, afterwards. The answer is the same with and without it.
    """
    size = current.shape[::-1]
    guesses = (None, None) if guess is None else (guess, turned_round(guess, *size))

    def one_way(method: FlowFunction, one: ByteArray, other: ByteArray, coarse: FloatArray | None) -> FloatArray:
        start = None if coarse is None else cv2.resize(coarse, size, interpolation=cv2.INTER_LINEAR)
        dense = (method(one, other, start) if boxes is None
                 else flow_in_regions(method, one, other, boxes, start=start))
        return np.asarray(cv2.resize(dense, (columns, rows), interpolation=cv2.INTER_AREA), np.float32)

    if second is None:
        there, back = one_way(flow, current, earlier, guesses[0]), one_way(flow, earlier, current, guesses[1])
    else:
        found = second.pool.submit(one_way, second.flow, earlier, current, guesses[1])
        there, back = one_way(flow, current, earlier, guesses[0]), found.result()
    cell_px = np.array([current.shape[1] / columns, current.shape[0] / rows], np.float32)
    target = there / cell_px + grid_points(rows, columns, columns, rows)
    returned = cv2.remap(back, target, None, cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE)
    return _checked(there, returned, np.float32(limit_px ** 2))


def total_to_residual(flow: FloatArray, matrix: DoubleArray, width: int, height: int) -> FloatArray:
    """What is left of a total flow when the ego-motion is taken out, in pixels of the later frame.

    flow: (gh, gw, 2) as in ``FlowField``; matrix: (3, 3) earlier pixel -> later pixel.
    Returns (gh, gw, 2): where the background would have carried the point's earlier position, to where it is.
    """
    points = grid_points(flow.shape[0], flow.shape[1], width, height)
    residual: FloatArray = points - apply(matrix, points - flow)
    return residual


@numba.njit(cache=True, nogil=True)
def _checked(there, returned, limit_squared):  # type: ignore[no-untyped-def]
    """``there`` (rows, columns, 2), NaN where ``returned``, the way back from where it leads, does not lead back."""
    checked = np.full(there.shape, np.nan, np.float32)
    for r in range(there.shape[0]):
        for c in range(there.shape[1]):
            dx, dy, back_x, back_y = there[r, c, 0], there[r, c, 1], returned[r, c, 0], returned[r, c, 1]
            error = (dx + back_x) * (dx + back_x) + (dy + back_y) * (dy + back_y)
            length = (dx * dx + dy * dy) + (back_x * back_x + back_y * back_y)
            if error <= limit_squared + np.float32(RETURN_SHARE) * length:
                checked[r, c, 0], checked[r, c, 1] = dx, dy
    return checked


@numba.njit(cache=True, nogil=True, error_model='numpy')
def _total(shift, back, scale, width, height):  # type: ignore[no-untyped-def]
    """(rows, columns, 2) full-resolution displacement: ``shift`` (working pixels, stabilised pair) and the ego-motion.

    back: (3, 3) float32 current pixel -> earlier pixel; NaN where the earlier one is not on the image.
    """
    rows, columns = shift.shape[:2]
    flow = np.full(shift.shape, np.nan, np.float32)
    across, down, half = np.float32(width / columns), np.float32(height / rows), np.float32(0.5)
    for r in range(rows):
        y = (np.float32(r) + half) * down - half
        for c in range(columns):
            x = (np.float32(c) + half) * across - half
            px, py = x + shift[r, c, 0] / scale, y + shift[r, c, 1] / scale
            depth = back[2, 0] * px + back[2, 1] * py + back[2, 2]
            from_x = (back[0, 0] * px + back[0, 1] * py + back[0, 2]) / depth
            from_y = (back[1, 0] * px + back[1, 1] * py + back[1, 2]) / depth
            if 0.0 <= from_x <= width - 1 and 0.0 <= from_y <= height - 1:
                flow[r, c, 0], flow[r, c, 1] = x - from_x, y - from_y
    return flow
