"""Ego-motion from tracked features (``ego_motion.method: indirect``)."""

from __future__ import annotations

from dataclasses import dataclass
from functools import partial

import numpy as np

from motion_detect_ros.core.config import EgoMotionConfig
from motion_detect_ros.core.deferred import Deferred
from motion_detect_ros.core.ego_motion.expected_motion import ExpectedMotion
from motion_detect_ros.core.ego_motion.features import BLOCK_PX, AllowedPlaces, check_features, find_features
from motion_detect_ros.core.ego_motion.measurement import MIN_TRACKS, EgoMotionMeasurement, centre_of, is_plausible
from motion_detect_ros.core.ego_motion.point_tracking import Tracks, track_close, track_points
from motion_detect_ros.core.ego_motion.rival_motions import RivalMotions
from motion_detect_ros.core.ego_motion.robust_fit import MotionFit, fit_motion
from motion_detect_ros.core.geometry.motion_models import model_family, theta_matrix
from motion_detect_ros.core.geometry.warp import apply, at_full_resolution, at_scale, stabilise
from motion_detect_ros.core.threads import threads
from motion_detect_ros.core.types import DoubleArray, EgoStatus, FloatArray, PreparedFrame

#: Change of the linear part from which a patch of the size of the tracking window is deformed so far that tracks err by
#: more than a few hundredths of a pixel.
DEFORMED = 0.05


@dataclass(frozen=True)
class _Features:
    """``points``: (N, 2) float32 pixels of ``frame``'s image."""

    frame: PreparedFrame
    points: FloatArray


class IndirectMethod:
    """Features found in the previous frame, tracked into the current one, and a robust fit to their displacements.

    They are looked for where the camera's motion takes them if it goes on, while it does. Those of the current frame,
    for the next one, may be looked for behind the answer.
    """

    def __init__(self, config: EgoMotionConfig) -> None:
        """Raises: BackendError for features that this OpenCV does not have."""
        self._config = config
        self._family = model_family(config.model)
        check_features(config.features)
        self._places = AllowedPlaces()
        self._ahead = Deferred[_Features]('features')
        self._expected = ExpectedMotion()
        self._rivals = RivalMotions()

    def measure(
        self, previous: PreparedFrame, frame: PreparedFrame, prior: DoubleArray | None = None,
    ) -> EgoMotionMeasurement:
        """As ``EgoMethod``; ``prior`` is the initial guess of the tracker."""
        ahead = self._ahead.take()
        features = ahead if ahead and ahead.frame is previous else self._features(previous)
        return self._tracked(previous, frame, features.points, prior)

    def look_ahead(self, frame: PreparedFrame) -> None:
        """Find the features of a frame in a thread; ``measure`` from that frame on waits for them, or, where there is
        no other thread, finds them.
        """
        self._ahead.drop()
        if threads() == 1:
            return
        self._ahead.start(partial(self._features, frame))

    def _tracked(
        self, previous: PreparedFrame, frame: PreparedFrame, points: FloatArray, prior: DoubleArray | None,
    ) -> EgoMotionMeasurement:
        if len(points) < MIN_TRACKS:
            return EgoMotionMeasurement(None, EgoStatus.LOW_TEXTURE, len(points))
        tracks = self._as_expected(previous, frame, points) if prior is None else None
        if tracks is None:
            at_work = None if prior is None else at_scale(prior, frame.scale)
            tracks = track_points(previous.gray, frame.gray, points, self._config, at_work, self._expected.starts)
        moved, good, _ = tracks
        earlier, later = at_full_resolution(points[good], frame.scale), at_full_resolution(moved[good], frame.scale)
        if len(earlier) < MIN_TRACKS:
            return EgoMotionMeasurement(None, EgoStatus.LOW_TEXTURE, len(earlier))
        fit = self._fit(earlier, later, previous, frame)
        if fit is None:
            return EgoMotionMeasurement(None, EgoStatus.DEGENERATE, len(earlier), earlier, later)
        matrix = theta_matrix(fit.theta, centre_of(frame))
        if np.abs(matrix[:2, :2] - np.eye(2)).max() > DEFORMED:
            fit = self._refined(matrix, points, previous, frame) or fit
            matrix = theta_matrix(fit.theta, centre_of(frame))
        self._expected.saw(previous, frame, matrix, tracks)
        return EgoMotionMeasurement(fit, EgoStatus.OK, len(earlier), earlier, later)

    def _as_expected(self, previous: PreparedFrame, frame: PreparedFrame, points: FloatArray) -> Tracks | None:
        """Followed from where they are expected; None where that is not known, or is not where they are."""
        expected = self._expected.between(previous, frame)
        if expected is None:
            return None
        tracks = track_close(previous.gray, frame.gray, points, self._config, at_scale(expected, frame.scale))
        return tracks if self._expected.confirmed_by(tracks) else None

    def wait(self) -> None:
        """Until the features of the last frame are found."""
        self._ahead.wait()

    def _features(self, frame: PreparedFrame) -> _Features:
        config = self._config
        return _Features(frame, find_features(
            config.features, frame.gray, config.max_corners, config.corner_quality, frame.mask, self._places))

    def _fit(
        self, points: FloatArray, moved: FloatArray, previous: PreparedFrame, frame: PreparedFrame,
    ) -> MotionFit | None:
        """points, moved: (N, 2) full-resolution pixels of the two frames."""
        centre, threshold_px = centre_of(frame), self._config.ransac_threshold_px
        fit = fit_motion(self._family, points, moved, threshold_px, centre)
        if fit is None or not is_plausible(fit, centre):
            return None
        return self._rivals.background(fit, self._family, points, moved, threshold_px, previous, frame)

    def _refined(
        self, matrix: DoubleArray, points: FloatArray, previous: PreparedFrame, frame: PreparedFrame,
    ) -> MotionFit | None:
        """Tracks again on the previous frame warped by the first estimate: rotated and scaled patches match badly."""
        at_work = at_scale(matrix, frame.scale)
        start = apply(at_work, points)
        seen = ((start > BLOCK_PX) & (start < np.array(frame.gray.shape[::-1]) - BLOCK_PX)).all(axis=1)
        if seen.sum() < MIN_TRACKS:
            return None
        warped = stabilise(previous.gray, at_work)
        moved, good, _ = track_close(warped, frame.gray, start[seen], self._config, np.eye(3))
        if good.sum() < MIN_TRACKS:
            return None
        return self._fit(
            at_full_resolution(points[seen][good], frame.scale), at_full_resolution(moved[good], frame.scale),
            previous, frame)
