"""Ego-motion from coarse dense flow (``ego_motion.method: flow``)."""

from __future__ import annotations

import cv2
import numpy as np

from motion_detect_ros.core.config import EgoMotionConfig
from motion_detect_ros.core.ego_motion.measurement import MIN_TRACKS, EgoMotionMeasurement, centre_of, is_plausible
from motion_detect_ros.core.ego_motion.robust_fit import MotionFit, fit_motion
from motion_detect_ros.core.flow_methods.dis import Dis
from motion_detect_ros.core.flow_methods.forward_backward import forward_backward_flow
from motion_detect_ros.core.geometry.motion_models import model_family, theta_matrix
from motion_detect_ros.core.geometry.warp import apply, at_scale, grid_points, inverse, stabilise
from motion_detect_ros.core.types import BoolArray, ByteArray, DoubleArray, EgoStatus, FloatArray, PreparedFrame

#: Spacing of the displacements that are fitted, working-resolution pixels: the size of a patch of the flow.
CELL_PX = 16
#: Finest level of the flow's pyramid.
FINEST_SCALE = 2
#: Smallest eigenvalue of the structure tensor (``cv2.cornerMinEigenVal``) under which the flow is not determined.
MIN_TEXTURE = 1e-5
#: Change of the linear part from which the flow is measured once more on the warped pair.
DEFORMED = 0.02
#: Share of a cell that must be visible.
WHOLE = 0.999
#: Share of the textured cells that must pass the forward-backward check, else the frames show different scenes.
MIN_RETURNED = 0.3


class FlowMethod:
    """Dense inverse search between the frames, forward-backward checked, and a robust fit on a grid."""

    def __init__(self, config: EgoMotionConfig) -> None:
        self._config = config
        self._family = model_family(config.model)
        self._flow = Dis(cv2.DISOPTICAL_FLOW_PRESET_FAST, FINEST_SCALE)

    def measure(
        self, previous: PreparedFrame, frame: PreparedFrame, prior: DoubleArray | None = None,
    ) -> EgoMotionMeasurement:
        """As ``EgoMethod``; with a ``prior`` the earlier frame is warped by it first."""
        measured = self._between(previous, frame, np.eye(3) if prior is None else prior)
        if measured.fit is None:
            return measured
        matrix = theta_matrix(measured.fit.theta, centre_of(frame))
        if np.abs(matrix[:2, :2] - np.eye(2)).max() < DEFORMED:
            return measured
        refined = self._between(previous, frame, matrix)
        return measured if refined.fit is None else refined

    def _between(self, previous: PreparedFrame, frame: PreparedFrame, matrix: DoubleArray) -> EgoMotionMeasurement:
        """matrix: (3, 3) by which the earlier frame is warped before the flow is measured, full resolution."""
        rows, columns = (max(1, side // CELL_PX) for side in frame.gray.shape)
        at_work = at_scale(matrix, frame.scale)
        earlier = stabilise(previous.gray, at_work)
        shift = forward_backward_flow(self._flow, earlier, frame.gray, rows, columns, self._config.forward_backward_px)
        here = grid_points(rows, columns, frame.width, frame.height)
        points = apply(inverse(matrix), here)
        asked = _textured(earlier, rows, columns) & _textured(frame.gray, rows, columns)
        asked &= _seen(previous.mask, earlier.shape, at_work, rows, columns)
        use = asked & np.isfinite(shift[..., 0])
        count = int(use.sum())
        if asked.sum() < MIN_TRACKS:
            return EgoMotionMeasurement(None, EgoStatus.LOW_TEXTURE, count)
        if count < max(MIN_TRACKS, MIN_RETURNED * asked.sum()):
            return EgoMotionMeasurement(None, EgoStatus.DEGENERATE, count)
        moved = here + shift / np.float32(frame.scale)
        fit = self._fit(points[use], moved[use], centre_of(frame))
        status = EgoStatus.DEGENERATE if fit is None else EgoStatus.OK
        return EgoMotionMeasurement(fit, status, count, points[use], moved[use])

    def _fit(self, points: FloatArray, moved: FloatArray, centre: DoubleArray) -> MotionFit | None:
        fit = fit_motion(self._family, points, moved, self._config.ransac_threshold_px, centre)
        return fit if is_plausible(fit, centre) else None


def _textured(gray: ByteArray, rows: int, columns: int) -> BoolArray:
    """(rows, columns): cells whose flow is determined by the image."""
    smallest = cv2.cornerMinEigenVal(cv2.resize(gray, None, fx=0.5, fy=0.5, interpolation=cv2.INTER_AREA), CELL_PX // 2)
    textured: BoolArray = cv2.resize(smallest, (columns, rows), interpolation=cv2.INTER_AREA) > MIN_TEXTURE
    return textured


def _seen(mask: BoolArray | None, shape: tuple[int, ...], matrix: DoubleArray, rows: int, columns: int) -> BoolArray:
    """(rows, columns): cells of the warped earlier frame that lie within the earlier image and its mask."""
    scene = np.ones(shape, np.uint8) if mask is None else mask.astype(np.uint8)
    warped = cv2.warpPerspective(scene, matrix, (shape[1], shape[0]), flags=cv2.INTER_NEAREST)
    seen: BoolArray = cv2.resize(warped.astype(np.float32), (columns, rows), interpolation=cv2.INTER_AREA) > WHOLE
    return seen
