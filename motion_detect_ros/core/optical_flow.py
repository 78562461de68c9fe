"""Dense optical flow between the current frame and an earlier one, both ways, on the stabilised pair."""

from __future__ import annotations

import cv2
import numpy as np

from motion_detect_ros.core.config import PipelineConfig
from motion_detect_ros.core.flow_backends import FlowFunction, make_flow
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
from motion_detect_ros.core.warp import apply, at_scale, grid_points, inverse, stabilise

#: Share of the squared lengths of both ways that their disagreement may reach (Sundaram et al. 2010, equation 5).
RETURN_SHARE = 0.01


class OpticalFlowStage:
    """Keeps the last frames; gives the flow over ``baseline_s`` seconds for each new one."""

    def __init__(self, config: PipelineConfig) -> None:
        self._config = config.optical_flow
        self._flow = make_flow(self._config)
        self._memory = FrameMemory(self._config.baseline_s)

    def reset(self) -> None:
        """Forget every earlier frame."""
        self._memory.reset()

    def process(self, frame: PreparedFrame, ego: EgoMotion) -> FlowField:
        """Flow into ``frame``; all NaN where there is no earlier frame or no ego-motion to stabilise with."""
        earlier = self._memory.step(frame, ego)
        flow = self._nothing(frame) if earlier is None else self._between(earlier, frame)
        return FlowField(flow, frame.width, frame.height, frame.stamp_ns)

    def _grid(self, frame: PreparedFrame) -> tuple[int, int]:
        rows, columns = frame.gray.shape
        return max(1, round(rows / self._config.grid_px)), max(1, round(columns / self._config.grid_px))

    def _nothing(self, frame: PreparedFrame) -> FloatArray:
        return np.full((*self._grid(frame), 2), np.nan, np.float32)

    def _between(self, earlier: Earlier, frame: PreparedFrame) -> FloatArray:
        """Total displacement on the grid: flow of the stabilised pair, put back under the ego-motion."""
        rows, columns = self._grid(frame)
        stabilised = stabilise(earlier.gray, at_scale(earlier.matrix, frame.scale))
        shift = both_ways(self._flow, frame.gray, stabilised, rows, columns, self._config.forward_backward_px)
        if self._config.search_px:
            shift = search_fast_movers(shift, frame.gray, stabilised, self._config.search_px)
        shift /= np.float32(frame.scale)
        points = grid_points(rows, columns, frame.width, frame.height)
        origin = apply(inverse(earlier.matrix), points + shift)
        flow = points - origin
        flow[outside(origin, frame.width, frame.height)] = np.nan
        return flow


def both_ways(
    flow: FlowFunction, current: ByteArray, earlier: ByteArray, rows: int, columns: int, limit_px: float,
) -> FloatArray:
    """(rows, columns, 2) displacement from ``current`` to ``earlier``, NaN where the way back does not return.

    Averaged over the cells of the grid first: most methods are no finer than that. limit_px: largest distance between
    a point and where the way there and back leads, plus a share of their lengths.
    """
    there, back = (cv2.resize(flow(one, other), (columns, rows), interpolation=cv2.INTER_AREA)
                   for one, other in ((current, earlier), (earlier, current)))
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
