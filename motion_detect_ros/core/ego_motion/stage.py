"""Ego-motion: motion of the background between two frames, caused by the camera."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from motion_detect_ros.core.config import PipelineConfig
from motion_detect_ros.core.ego_motion.agreement import agrees, agrees_rather
from motion_detect_ros.core.ego_motion.alternatives.gyro_prior import GyroPrior, Prior
from motion_detect_ros.core.ego_motion.alternatives.relative_pose import RelativePoseEstimator
from motion_detect_ros.core.ego_motion.feature_based import IndirectMethod
from motion_detect_ros.core.ego_motion.measurement import EgoMotionMeasurement, centre_of
from motion_detect_ros.core.ego_motion.methods import make_method
from motion_detect_ros.core.ego_motion.robust_fit import MotionFit
from motion_detect_ros.core.ego_motion.smoothing import make_smoother
from motion_detect_ros.core.geometry.affine import to_centre
from motion_detect_ros.core.geometry.motion_models import theta_matrix
from motion_detect_ros.core.geometry.resizing import at_resolution_of
from motion_detect_ros.core.types import (
    NANOSECONDS,
    CameraModel,
    DoubleArray,
    EgoMotion,
    EgoStatus,
    PreparedFrame,
    RelativePose,
)


class EgoMotionStage:
    """Measures the background's motion from frame to frame and smooths its parameters."""

    def __init__(self, config: PipelineConfig, camera: CameraModel | None = None) -> None:
        """Raises: BackendError for features that this OpenCV does not have."""
        self.camera = camera
        self.use_config(config)
        self._filter = make_smoother(self._config)
        self._gyro = GyroPrior(config.imu)
        self._relative_pose = RelativePoseEstimator(config.background.focal_share)
        self._previous: PreparedFrame | None = None
        self._passed_over: PreparedFrame | None = None
        self._jumped = False

    def use_config(self, config: PipelineConfig) -> None:
        """Settings from the next frame on that keep history (``core.reconfiguration``). Raises: BackendError."""
        self._config = config.ego_motion
        self._method = make_method(self._config)

    def reset(self) -> None:
        """Clear the previous frame, the filter's state, the relative pose and the angular rates."""
        self._start_at(None)
        self._gyro.reset()

    def _start_at(self, frame: PreparedFrame | None) -> None:
        """Forget all motion; the next one is that from ``frame``."""
        self._previous, self._passed_over = frame, None
        self._forget()

    def _forget(self) -> None:
        self._filter.reset()
        self._relative_pose.reset()

    def wait(self) -> None:
        """Until what is done behind the last frame is done; ``process`` does so itself."""
        if isinstance(self._method, IndirectMethod):
            self._method.wait()

    def add_gyro(self, stamp_ns: int, rate: DoubleArray) -> None:
        """Add an angular rate, in order of time, before the first later frame. Ignored without ``imu.use``.

        stamp_ns: of the IMU's clock; rate: (3,) rad/s in the IMU's frame (``core.ego_motion.alternatives.imu``).
        """
        self._gyro.add(stamp_ns, rate)

    def clock_jumped(self) -> None:
        """The next frame is of another run of the clock, whatever its stamp: its status is TIME_JUMP."""
        self._jumped = True

    def look_ahead(self) -> None:
        """Do in a thread what the next frame needs of the last one; without it, the next frame does."""
        if self._previous is not None and isinstance(self._method, IndirectMethod):
            self._method.look_ahead(self._previous)

    def process(self, frame: PreparedFrame) -> EgoMotion:
        """Motion from an earlier frame to ``frame``. Image content never raises: see ``status``.

        From that of the last call, or from the last one with a motion, where those after it told none: a picture that
        is damaged or covered for a moment costs only itself. Where the gyroscope tells the motion, that is a motion.
        """
        status = self._continuity(self._passed_over or self._previous, frame)
        jumped, self._jumped = self._jumped, False
        if jumped and status == EgoStatus.OK:
            status = EgoStatus.TIME_JUMP
        if status != EgoStatus.OK:
            self._start_at(frame)
            return no_estimate(status, frame.stamp_ns, frame.stamp_ns)
        starts = [each for each in (self._previous, self._passed_over)
                  if each is not None and self._continuity(each, frame) == EgoStatus.OK]
        if starts[0] is not self._previous:  # it is too old
            self._start_at(starts[0])
        ego = self._between(starts[0], frame)
        if len(starts) > 1 and ego.status in (EgoStatus.LOW_TEXTURE, EgoStatus.DEGENERATE):
            cut = self._between(starts[1], frame, anew=True)
            ego = cut if cut.ok else ego
        self._previous, self._passed_over = (frame, None) if ego.ok else (starts[0], frame)
        return ego

    def _between(self, previous: PreparedFrame, frame: PreparedFrame, *, anew: bool = False) -> EgoMotion:
        """anew: if there is a motion between them, forget all before."""
        previous = at_resolution_of(previous, frame)
        prior = self._gyro.between(previous, frame, self.camera)
        measured = self._measured(previous, frame, prior)
        if anew and (measured.fit is not None or prior is not None):
            self._forget()
        ego = self._planar(measured, prior, previous, frame)
        return replace(ego, camera=self._camera_motion(measured, frame)) if self._config.relative_pose else ego

    def _measured(self, previous: PreparedFrame, frame: PreparedFrame, prior: Prior | None) -> EgoMotionMeasurement:
        measured = self._method.measure(previous, frame, None if prior is None else prior.matrix)
        fit = measured.fit
        if fit and not agrees(previous, frame, theta_matrix(fit.theta, centre_of(frame)), fit.residual_px):
            return EgoMotionMeasurement(None, EgoStatus.DEGENERATE, measured.tracks)
        return measured

    def _planar(
        self, measured: EgoMotionMeasurement, prior: Prior | None, previous: PreparedFrame, frame: PreparedFrame,
    ) -> EgoMotion:
        if measured.fit is None:
            if prior is not None:
                return prior.ego_motion(frame.stamp_ns, previous.stamp_ns, measured.tracks)
            return no_estimate(measured.status, frame.stamp_ns, previous.stamp_ns, measured.tracks)
        return self._smoothed(measured.fit, previous, frame)

    def _continuity(self, previous: PreparedFrame | None, frame: PreparedFrame) -> EgoStatus:
        if previous is None:
            return EgoStatus.FIRST_FRAME
        if (previous.width, previous.height) != (frame.width, frame.height):
            return EgoStatus.SIZE_CHANGE
        dt_s = (frame.stamp_ns - previous.stamp_ns) / NANOSECONDS
        return EgoStatus.OK if 0.0 < dt_s <= self._config.max_gap_s else EgoStatus.TIME_JUMP

    def _camera_motion(self, measured: EgoMotionMeasurement, frame: PreparedFrame) -> RelativePose | None:
        if measured.earlier is None or measured.current is None:
            self._relative_pose.reset()
            return None
        return self._relative_pose.estimate(measured.earlier, measured.current, frame.width, frame.height, self.camera)

    def _smoothed(self, fit: MotionFit, previous: PreparedFrame, frame: PreparedFrame) -> EgoMotion:
        """The affine part filtered; the perspective part of the warp as measured."""
        dt_s, tracks = (frame.stamp_ns - previous.stamp_ns) / NANOSECONDS, len(fit.inliers)
        centre = centre_of(frame)

        def shown(expected: DoubleArray) -> bool:
            foretold = theta_matrix(np.r_[expected, fit.theta[6:]], centre)
            return agrees_rather(previous, frame, theta_matrix(fit.theta, centre), foretold)

        params, covariance, accepted = self._filter.update(
            fit.theta[:6], fit.covariance[:6, :6], frame.stamp_ns, dt_s, shown)
        if not accepted:
            return no_estimate(EgoStatus.OUTLIER_GATED, frame.stamp_ns, previous.stamp_ns, tracks)
        back = np.linalg.inv(to_centre(centre))
        return EgoMotion(
            theta_matrix(np.r_[params, fit.theta[6:]], centre), back @ covariance @ back.T, EgoStatus.OK,
            frame.stamp_ns, previous.stamp_ns, int(fit.inliers.sum()), tracks, fit.residual_px, fit.model)


def no_estimate(status: EgoStatus, stamp_ns: int, prev_stamp_ns: int, tracks: int = 0) -> EgoMotion:
    """An ``EgoMotion`` without estimate, with the reason: identity matrix, NaN covariance."""
    nothing: DoubleArray = np.full((6, 6), np.nan)
    return EgoMotion(np.eye(3), nothing, status, stamp_ns, prev_stamp_ns, tracks=tracks)
