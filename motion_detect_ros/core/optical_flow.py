"""Dense optical flow between the current frame and an earlier one, both ways, on the stabilised pair."""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np

from motion_detect_ros.core.config import PipelineConfig
from motion_detect_ros.core.flow_backends import FlowFunction, make_flow
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


class OpticalFlowStage:
    """Keeps the last frames; gives the flow over ``baseline_s`` seconds for each new one."""

    def __init__(self, config: PipelineConfig) -> None:
        self._config = config.optical_flow
        self._flow = make_flow(self._config)
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
                          guess if self._config.warm_start else None, boxes)
        if self._config.search_px:
            shift = search_fast_movers(shift, frame.gray, stabilised, self._config.search_px)
        self._last = _Last(shift.copy(), frame.stamp_ns, since_full)
        shift /= np.float32(frame.scale)
        points = grid_points(rows, columns, frame.width, frame.height)
        origin = apply(inverse(earlier.matrix), points + shift)
        flow = points - origin
        flow[outside(origin, frame.width, frame.height)] = np.nan
        return flow


def both_ways(
    flow: FlowFunction, current: ByteArray, earlier: ByteArray, rows: int, columns: int, limit_px: float,
    guess: FloatArray | None = None, boxes: Boxes | None = None,
) -> FloatArray:
    """(rows, columns, 2) displacement from ``current`` to ``earlier``, NaN where the way back does not return.

    Averaged over the cells of the grid first: most methods are no finer than that. limit_px: largest distance between
    a point and where the way there and back leads, plus a share of their lengths. guess: (rows, columns, 2) what
    to start from; boxes: (n, 4) regions as of ``flow_in_regions``, NaN outside; None = everywhere.
    """
    size = current.shape[::-1]
    guesses = (None, None) if guess is None else (guess, turned_round(guess, *size))
    found = []
    for one, other, coarse in ((current, earlier, guesses[0]), (earlier, current, guesses[1])):
        start = None if coarse is None else cv2.resize(coarse, size, interpolation=cv2.INTER_LINEAR)
        dense = (flow(one, other, start) if boxes is None
                 else flow_in_regions(flow, one, other, boxes, start=start))
        found.append(cv2.resize(dense, (columns, rows), interpolation=cv2.INTER_AREA))
    there, back = found
    cell_px = np.array([current.shape[1] / columns, current.shape[0] / rows], np.float32)
    target = there / cell_px + grid_points(rows, columns, columns, rows)
    returned = cv2.remap(back, target, None, cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE)
    error = np.square(there + returned).sum(axis=2)
    length = np.square(there).sum(axis=2) + np.square(returned).sum(axis=2)
    there[~(error <= limit_px ** 2 + RETURN_SHARE * length)] = np.nan
    checked: FloatArray = there
    return checked


def outside(points: FloatArray, width: int, height: int) -> np.ndarray:
    """True for points that are not on the image."""
    x, y = points[..., 0], points[..., 1]
    inside: np.ndarray = (x >= 0) & (y >= 0) & (x <= width - 1) & (y <= height - 1)
    return ~inside


def total_to_residual(flow: FloatArray, matrix: DoubleArray, width: int, height: int) -> FloatArray:
    """What is left of a total flow when the ego-motion is taken out, in pixels of the later frame.

    flow: (gh, gw, 2) as in ``FlowField``; matrix: (3, 3) earlier pixel -> later pixel.
    Returns (gh, gw, 2): where the background would have carried the point's earlier position, to where it is.
    """
    points = grid_points(flow.shape[0], flow.shape[1], width, height)
    residual: FloatArray = points - apply(matrix, points - flow)
    return residual
