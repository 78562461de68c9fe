"""Interface of the ego-motion methods."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Protocol

import numpy as np

from motion_detect_ros.core.ego_motion.robust_fit import MotionFit
from motion_detect_ros.core.geometry.motion_models import theta_matrix
from motion_detect_ros.core.types import DoubleArray, EgoStatus, FloatArray, PreparedFrame

#: Least number of measurements (corners, cells), and of inliers, of an estimate.
MIN_TRACKS = 12
MIN_INLIERS = 10
#: Determinant of the linear part outside which a frame-to-frame warp is not a camera motion.
DETERMINANT_RANGE = (0.5, 2.0)
#: Largest standard deviation of any parameter of a determined motion, pixels.
MAX_SIGMA_PX = 5.0


@dataclass(frozen=True)
class EgoMotionMeasurement:
    """``fit``: full-resolution pixels, None with the reason as ``status``; ``tracks``: number of measurements.

    ``earlier``, ``current``: (N, 2) their positions in the two frames, outliers included, full-resolution pixels; None
    where the method uses no points.
    """

    fit: MotionFit | None
    status: EgoStatus
    tracks: int
    earlier: FloatArray | None = None
    current: FloatArray | None = None


class EgoMethod(Protocol):
    """Estimates the motion from one frame to the next."""

    def measure(
        self, previous: PreparedFrame, frame: PreparedFrame, prior: DoubleArray | None = None,
    ) -> EgoMotionMeasurement:
        """prior: (3, 3) first guess, previous pixel -> current pixel, full resolution; None = none."""
        ...


def centre_of(frame: PreparedFrame) -> DoubleArray:
    """(2,) centre of the full-resolution image, pixels."""
    return np.array([frame.width / 2.0, frame.height / 2.0])


def is_plausible(fit: MotionFit | None, centre: DoubleArray) -> bool:
    """Whether there are enough inliers, the motion is determined, and its scale is possible for a camera."""
    if fit is None or fit.inliers.sum() < MIN_INLIERS:
        return False
    if not np.diag(fit.covariance).max() <= MAX_SIGMA_PX ** 2:  # NaN is not plausible
        return False
    low, high = DETERMINANT_RANGE
    (a, b, _), (c, d, _), _ = theta_matrix(fit.theta, centre).tolist()
    return low < a * d - b * c < high
