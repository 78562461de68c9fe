"""Ego-motion from tracked features (``ego_motion.method: indirect``)."""

from __future__ import annotations

import cv2
import numpy as np

from motion_detect_ros.core.config import EgoMotionConfig
from motion_detect_ros.core.ego_measured import MIN_TRACKS, Measured, believable, centre_of
from motion_detect_ros.core.features import check_features, find_features
from motion_detect_ros.core.motion_models import model_family, theta_matrix
from motion_detect_ros.core.robust_fit import MotionFit, fit_motion
from motion_detect_ros.core.types import BoolArray, ByteArray, DoubleArray, EgoStatus, FloatArray, PreparedFrame
from motion_detect_ros.core.warp import apply, at_scale, inverse, stabilise

#: Change of the linear part from which a patch of the size of the tracking window is visibly deformed.
DEFORMED = 0.02


class IndirectMethod:
    """Features found in the previous frame, tracked into the current one, and a robust fit to their displacements."""

    def __init__(self, config: EgoMotionConfig) -> None:
        """Raises: BackendError for features that this OpenCV does not have."""
        self._config = config
        self._family = model_family(config.model)
        check_features(config.features)

    def measure(self, previous: PreparedFrame, frame: PreparedFrame, prior: DoubleArray | None = None) -> Measured:
        """As ``EgoMethod``; ``prior`` is where the tracker starts to look."""
        at_work = None if prior is None else at_scale(prior, frame.scale)
        points, moved = self._tracks(previous.gray, frame.gray, previous.mask, at_work)
        if len(points) < MIN_TRACKS:
            return Measured(None, EgoStatus.LOW_TEXTURE, len(points))
        fit = self._fit(points / np.float32(frame.scale), moved / np.float32(frame.scale), frame)
        if fit is None:
            return Measured(None, EgoStatus.DEGENERATE, len(points))
        matrix = theta_matrix(fit.theta, centre_of(frame))
        if np.abs(matrix[:2, :2] - np.eye(2)).max() > DEFORMED:
            fit = self._refined(matrix, previous, frame) or fit
        return Measured(fit, EgoStatus.OK, len(points))

    def _tracks(
        self, previous: ByteArray, current: ByteArray, mask: BoolArray | None, prior: DoubleArray | None = None,
    ) -> tuple[FloatArray, FloatArray]:
        """Positions in both images, working-resolution pixels, that survive a forward-backward check.

        mask: (h, w), False where nothing of ``previous`` is tracked; None = everywhere.
        """
        config = self._config
        points = find_features(config.features, previous, config.max_corners, config.corner_quality, mask)
        if not len(points):
            return points, points
        moved, found = self._track(previous, current, points, None if prior is None else apply(prior, points))
        back, found_back = self._track(current, previous, moved, None if prior is None else points)
        good = found & found_back & np.isfinite(moved).all(axis=1)
        good &= np.hypot(*(back - points).T) < config.forward_backward_px
        return points[good], moved[good]

    def _track(
        self, one: ByteArray, other: ByteArray, points: FloatArray, guess: FloatArray | None,
    ) -> tuple[FloatArray, BoolArray]:
        """Where ``points`` of one image are in the other (Bouguet 2001), and which of them were found."""
        window = (self._config.lk_window_px, self._config.lk_window_px)
        flags = 0 if guess is None else cv2.OPTFLOW_USE_INITIAL_FLOW
        moved, found, _ = cv2.calcOpticalFlowPyrLK(
            one, other, points, None if guess is None else guess.copy(), winSize=window,
            maxLevel=self._config.pyramid_levels, flags=flags)
        return moved, found.ravel() > 0

    def _fit(self, points: FloatArray, moved: FloatArray, frame: PreparedFrame) -> MotionFit | None:
        centre = centre_of(frame)
        fit = fit_motion(self._family, points, moved, self._config.ransac_threshold_px, centre)
        return fit if believable(fit, centre) else None

    def _refined(self, matrix: DoubleArray, previous: PreparedFrame, frame: PreparedFrame) -> MotionFit | None:
        """Tracks again on the previous frame warped by the first estimate: turned and scaled patches match badly."""
        at_work = at_scale(matrix, frame.scale)
        mask = None if previous.mask is None else stabilise(previous.mask.astype(np.uint8), at_work) > 0
        points, moved = self._tracks(stabilise(previous.gray, at_work), frame.gray, mask)
        if len(points) < MIN_TRACKS:
            return None
        origin = apply(inverse(matrix), points / np.float32(frame.scale))
        return self._fit(origin, moved / np.float32(frame.scale), frame)
