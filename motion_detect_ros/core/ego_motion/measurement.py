"""What every way to measure the ego-motion takes and gives."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Protocol

import numpy as np

from motion_detect_ros.core.ego_motion.robust_fit import MotionFit
from motion_detect_ros.core.geometry.motion_models import theta_matrix
from motion_detect_ros.core.types import DoubleArray, EgoStatus, FloatArray, PreparedFrame

#: Measurements (corners, cells) that are needed, and that must agree, before an estimate is believed.
MIN_TRACKS = 12
MIN_INLIERS = 10
#: Determinant of the linear part outside which a frame-to-frame warp is not a camera motion.
DETERMINANT_RANGE = (0.5, 2.0)
#: Deviation of any parameter from which the measurements do not determine the motion, pixels.
MAX_SIGMA_PX = 5.0


@dataclass(frozen=True)
class EgoMotionMeasurement:
    """``fit``: full-resolution pixels, None with a ``status`` that says why; ``tracks``: measurements it rests on.

    ``earlier``, ``current``: (N, 2) where they are in the two frames, outliers included, full-resolution pixels; None
    where the method compares no points.
    """

    fit: MotionFit | None
    status: EgoStatus
    tracks: int
    earlier: FloatArray | None = None
    current: FloatArray | None = None


class EgoMethod(Protocol):
    """A way to measure the motion from one frame to the next."""

    def measure(
        self, previous: PreparedFrame, frame: PreparedFrame, prior: DoubleArray | None = None,
    ) -> EgoMotionMeasurement:
        """prior: (3, 3) first guess, previous pixel -> current pixel, full resolution; None = none."""
        ...


def centre_of(frame: PreparedFrame) -> DoubleArray:
    """(2,) centre of the full-resolution image, pixels."""
    return np.array([frame.width / 2.0, frame.height / 2.0])


def is_plausible(fit: MotionFit | None, centre: DoubleArray) -> bool:
    """Whether enough points agree, the motion is determined, and a camera can move like that."""
    if fit is None or fit.inliers.sum() < MIN_INLIERS:
        return False
    if not np.diag(fit.covariance).max() <= MAX_SIGMA_PX ** 2:  # NaN is not is_plausible
        return False
    low, high = DETERMINANT_RANGE
    return bool(low < np.linalg.det(theta_matrix(fit.theta, centre)[:2, :2]) < high)
