"""Ego-motion prior from the gyroscope, and the estimate where the image gives none."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.spatial.transform import Rotation

from motion_detect_ros.core.config import ImuConfig
from motion_detect_ros.core.ego_motion.alternatives.imu import GyroBuffer, rotation_homography
from motion_detect_ros.core.ego_motion.measurement import centre_of
from motion_detect_ros.core.geometry.affine import to_centre
from motion_detect_ros.core.geometry.motion_models import matrix_theta
from motion_detect_ros.core.types import (
    CameraModel,
    DoubleArray,
    EgoMotion,
    EgoStatus,
    MotionModel,
    PreparedFrame,
)

#: Step of the numerical derivative, radians.
STEP_RAD = 1e-5


@dataclass(frozen=True)
class Prior:
    """``matrix``: (3, 3) homography of the rotation, previous pixel -> current pixel, full resolution.

    ``covariance``: (6, 6) of its affine part a0..a5, from the gyroscope's noise alone: it does not
    contain the parallax of a camera that travels.
    """

    matrix: DoubleArray
    covariance: DoubleArray

    def ego_motion(self, stamp_ns: int, prev_stamp_ns: int, tracks: int) -> EgoMotion:
        """The rotation as estimate: OK with no inliers."""
        return EgoMotion(self.matrix, self.covariance, EgoStatus.OK, stamp_ns, prev_stamp_ns, 0, tracks,
                         model=MotionModel.HOMOGRAPHY)


class GyroPrior:
    """Collects angular rates and integrates them to a ``Prior`` for each pair of frames."""

    def __init__(self, config: ImuConfig) -> None:
        self._config = config
        self._buffer = GyroBuffer(config)

    def reset(self) -> None:
        """Clear all samples."""
        self._buffer.reset()

    def add(self, stamp_ns: int, rate: DoubleArray) -> None:
        """As ``GyroBuffer.add``; ignored unless ``imu.use``."""
        if self._config.use:
            self._buffer.add(stamp_ns, rate)

    def between(
        self, previous: PreparedFrame, frame: PreparedFrame, camera: CameraModel | None,
    ) -> Prior | None:
        """None without calibration or samples, or where the views hardly overlap."""
        if not self._config.use or camera is None:
            return None
        rotation = self._buffer.rotation(previous.stamp_ns, frame.stamp_ns)
        if rotation is None:
            return None
        camera = camera.resized(frame.width, frame.height)
        matrix = rotation_homography(rotation, camera)
        if matrix is None:
            return None
        dt_s = (frame.stamp_ns - previous.stamp_ns) * 1e-9
        return Prior(matrix, _covariance(rotation, camera, centre_of(frame), self._config.noise_rad_s * dt_s))


def _covariance(rotation: DoubleArray, camera: CameraModel, centre: DoubleArray, sigma_rad: float) -> DoubleArray:
    """(6, 6) of a0..a5 where ``rotation`` has an error of ``sigma_rad`` about every axis."""
    slopes = []
    for axis in np.eye(3):
        turned = [rotation_homography(Rotation.from_rotvec(step * axis).as_matrix() @ rotation, camera)
                  for step in (-STEP_RAD, STEP_RAD)]
        theta = [matrix_theta(np.eye(3) if matrix is None else matrix, centre)[:6] for matrix in turned]
        slopes.append((theta[1] - theta[0]) / (2.0 * STEP_RAD))
    spread = sigma_rad * np.linalg.solve(to_centre(centre), np.array(slopes).T)
    covariance: DoubleArray = spread @ spread.T
    return covariance
