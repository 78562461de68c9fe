"""Dense optical flow between the current frame and the reference frame, stabilised, forward and backward."""

from __future__ import annotations

from collections.abc import Callable
from functools import partial

import numpy as np

from motion_detect_ros.core.config import PipelineConfig
from motion_detect_ros.core.flow_methods.forward_backward import BackwardWorker, forward_backward_flow
from motion_detect_ros.core.flow_methods.registry import BUILT_IN, make_flow
from motion_detect_ros.core.geometry.frame_history import ReferenceFrame
from motion_detect_ros.core.geometry.warp import at_scale, stabilise
from motion_detect_ros.core.optical_flow.alternatives.regions import RegionsOfInterest, confined
from motion_detect_ros.core.optical_flow.conversion import total_flow
from motion_detect_ros.core.periods import Every
from motion_detect_ros.core.threads import ApartPool, threads
from motion_detect_ros.core.types import EgoMotion, FloatArray, FlowField, PreparedFrame


class OpticalFlowStage:
    """Computes the flow from the reference frame, ``baseline_s`` seconds ago, into each new frame."""

    def __init__(self, config: PipelineConfig) -> None:
        """Raises: BackendError where the method is not in this installation."""
        self._pool = ApartPool(1, 'backward_flow')
        self.use_config(config)
        self._regions = RegionsOfInterest(self._config.full_every)
        self._every = Every(self._config.every_s, eager=True)

    def use_config(self, config: PipelineConfig) -> None:
        """Settings from the next frame on that keep history (``core.reconfiguration``). Raises: BackendError."""
        self._config = config.optical_flow
        self._flow = make_flow(self._config)
        self._worker = (BackwardWorker(make_flow(self._config), self._pool)
                        if self._config.method in BUILT_IN else None)

    def reset(self) -> None:
        """Clear the last flow."""
        self._regions.reset()
        self._every.reset()

    def process(
        self, frame: PreparedFrame, ego: EgoMotion, reference: ReferenceFrame | None, later: bool = False,
    ) -> FlowField:
        """Flow from ``reference`` into ``frame``; all NaN without a reference, and in frames where none is due.

        ego: motion into ``frame``; reference: what ``FrameHistory`` returns for it. later: computed when it is asked
        for, where the next one does not depend on it; settings must not change before.
        """
        if ego.passed_over:
            return FlowField(self._unknown(frame), frame.width, frame.height, frame.stamp_ns)
        if not ego.ok:
            self._every.reset()
        flow: FloatArray | Callable[[], FloatArray]
        if not self._every.due(ego.dt_s) or reference is None:
            flow = self._unknown(frame)
        else:
            flow = partial(self._between, reference, frame, ego)
            if not later or self._config.full_every > 1:
                flow = flow()
            self._every.done()
        return FlowField(flow, frame.width, frame.height, frame.stamp_ns)

    def _unknown(self, frame: PreparedFrame) -> FloatArray:
        return np.full((*grid_shape(frame, self._config.grid_px), 2), np.nan, np.float32)

    def _between(self, reference: ReferenceFrame, frame: PreparedFrame, ego: EgoMotion) -> FloatArray:
        """Total displacement on the grid: flow of the stabilised pair composed with the ego-motion."""
        rows, columns = grid_shape(frame, self._config.grid_px)
        stabilised = stabilise(reference.gray, at_scale(reference.matrix, frame.scale))
        boxes = self._regions.boxes(frame, ego, (rows, columns))
        worker = self._worker if threads() > 1 else None
        shift = forward_backward_flow(
            confined(self._flow, boxes), frame.gray, stabilised, rows, columns, self._config.forward_backward_px,
            worker and BackwardWorker(confined(worker.flow, boxes), worker.pool))
        self._regions.remember(shift, frame.stamp_ns)
        return total_flow(shift, reference.matrix, frame.scale, frame.width, frame.height)


def grid_shape(frame: PreparedFrame, grid_px: int) -> tuple[int, int]:
    """Rows and columns of the flow's grid, cells of ``grid_px`` working-resolution pixels."""
    rows, columns = frame.gray.shape
    return max(1, round(rows / grid_px)), max(1, round(columns / grid_px))
