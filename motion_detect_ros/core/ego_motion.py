"""Ego-motion: how the camera's own motion moved the background between two frames."""

from __future__ import annotations

import cv2
import numpy as np

from motion_detect_ros.core.affine import (
    AffineFit,
    affine_matrix,
    affine_params,
    refine_affine,
)
from motion_detect_ros.core.config import PipelineConfig
from motion_detect_ros.core.features import check_features, find_features
from motion_detect_ros.core.kalman import ParameterKalman
from motion_detect_ros.core.types import (
    NANOSECONDS,
    BoolArray,
    ByteArray,
    CameraModel,
    DoubleArray,
    EgoMotion,
    EgoStatus,
    FloatArray,
    MotionModel,
    PreparedFrame,
)
from motion_detect_ros.core.warp import apply, at_scale, inverse, stabilise

#: Corners that must be tracked, and that must agree, before an estimate is believed.
MIN_TRACKS = 12
MIN_INLIERS = 10
#: Change of the linear part from which a patch of the size of the tracking window is visibly deformed.
DEFORMED = 0.02
#: Determinant of the linear part outside which a frame-to-frame affine is not a camera motion.
DETERMINANT_RANGE = (0.5, 2.0)


class EgoMotionStage:
    """Tracks corners from frame to frame, fits an affine robustly and smooths it with a Kalman filter."""

    def __init__(self, config: PipelineConfig, camera: CameraModel | None = None) -> None:
        self._config = config.ego_motion
        check_features(self._config.features)
        self.camera = camera
        self._filter = ParameterKalman(self._config)
        self._previous: PreparedFrame | None = None
        cv2.setRNGSeed(0)

    def reset(self) -> None:
        """Forget the previous frame and the filter's state."""
        self._previous = None
        self._filter.reset()

    def process(self, frame: PreparedFrame) -> EgoMotion:
        """Motion from the frame of the last call to ``frame``. Never raises on image content: see ``status``."""
        previous, self._previous = self._previous, frame
        status = self._continuity(previous, frame)
        if previous is None or status != EgoStatus.OK:
            self._filter.reset()
            return no_estimate(status, frame.stamp_ns, frame.stamp_ns)
        points, moved = self._tracks(previous.gray, frame.gray, previous.mask)
        return self._estimate(points / frame.scale, moved / frame.scale, previous, frame)

    def _continuity(self, previous: PreparedFrame | None, frame: PreparedFrame) -> EgoStatus:
        if previous is None:
            return EgoStatus.FIRST_FRAME
        if (previous.width, previous.height) != (frame.width, frame.height):
            return EgoStatus.SIZE_CHANGE
        dt_s = (frame.stamp_ns - previous.stamp_ns) / NANOSECONDS
        return EgoStatus.OK if 0.0 < dt_s <= self._config.max_gap_s else EgoStatus.TIME_JUMP

    def _tracks(
        self, previous: ByteArray, current: ByteArray, mask: BoolArray | None,
    ) -> tuple[FloatArray, FloatArray]:
        """Positions in both images, working-resolution pixels, that survive a forward-backward check.

        mask: (h, w), False where nothing of ``previous`` is tracked; None = everywhere.
        """
        config = self._config
        points = find_features(config.features, previous, config.max_corners, config.corner_quality, mask)
        if not len(points):
            return points, points
        window = (config.lk_window_px, config.lk_window_px)
        moved, found, _ = cv2.calcOpticalFlowPyrLK(
            previous, current, points, None, winSize=window, maxLevel=config.pyramid_levels)
        back, found_back, _ = cv2.calcOpticalFlowPyrLK(
            current, previous, moved, None, winSize=window, maxLevel=config.pyramid_levels)
        good = (found.ravel() > 0) & (found_back.ravel() > 0) & np.isfinite(moved).all(axis=1)
        good &= np.hypot(*(back - points).T) < config.forward_backward_px
        return points[good], moved[good]

    def _estimate(
        self, points: FloatArray, moved: FloatArray, previous: PreparedFrame, frame: PreparedFrame,
    ) -> EgoMotion:
        if len(points) < MIN_TRACKS:
            self._filter.reset()
            return no_estimate(EgoStatus.LOW_TEXTURE, frame.stamp_ns, previous.stamp_ns, len(points))
        fit = self._fit(points, moved)
        if fit is not None and np.abs(affine_matrix(fit.params)[:2, :2] - np.eye(2)).max() > DEFORMED:
            fit = self._refined(fit, previous, frame) or fit
        if fit is None:
            self._filter.reset()
            return no_estimate(EgoStatus.DEGENERATE, frame.stamp_ns, previous.stamp_ns, len(points))
        dt_s = (frame.stamp_ns - previous.stamp_ns) / NANOSECONDS
        centre = np.array([frame.width / 2.0, frame.height / 2.0])
        params, covariance, accepted = self._filter.update(fit.params, fit.covariance, frame.stamp_ns, dt_s, centre)
        if not accepted:
            return no_estimate(EgoStatus.OUTLIER_GATED, frame.stamp_ns, previous.stamp_ns, len(points))
        return EgoMotion(
            affine_matrix(params), covariance, EgoStatus.OK, frame.stamp_ns, previous.stamp_ns,
            int(fit.inliers.sum()), len(points), fit.residual_px, MotionModel.AFFINE)

    def _fit(self, points: FloatArray, moved: FloatArray) -> AffineFit | None:
        """RANSAC, then re-weighted least squares; None where the points do not determine an affine."""
        threshold = self._config.ransac_threshold_px
        start, _ = cv2.estimateAffine2D(points, moved, method=cv2.RANSAC, ransacReprojThreshold=threshold)
        if start is None or not np.isfinite(start).all():
            return None
        fit = refine_affine(points, moved, affine_params(np.vstack([start, [0.0, 0.0, 1.0]])))
        low, high = DETERMINANT_RANGE
        determinant = float(np.linalg.det(affine_matrix(fit.params)))
        return fit if fit.inliers.sum() >= MIN_INLIERS and low < determinant < high else None


    def _refined(self, fit: AffineFit, previous: PreparedFrame, frame: PreparedFrame) -> AffineFit | None:
        """Tracks again on the previous frame warped by the first estimate: turned and scaled patches match badly."""
        matrix = at_scale(affine_matrix(fit.params), frame.scale)
        mask = None if previous.mask is None else stabilise(previous.mask.astype(np.uint8), matrix) > 0
        points, moved = self._tracks(stabilise(previous.gray, matrix), frame.gray, mask)
        if len(points) < MIN_TRACKS:
            return None
        origin = apply(inverse(affine_matrix(fit.params)), points / np.float32(frame.scale))
        return self._fit(origin, moved / frame.scale)


def no_estimate(status: EgoStatus, stamp_ns: int, prev_stamp_ns: int, tracks: int = 0) -> EgoMotion:
    """An ``EgoMotion`` that says why there is none: identity matrix, NaN covariance."""
    nothing: DoubleArray = np.full((6, 6), np.nan)
    return EgoMotion(np.eye(3), nothing, status, stamp_ns, prev_stamp_ns, tracks=tracks)
