"""Displacements of points against the background over one baseline, and their noise."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from motion_detect_ros.core.geometry.cells import first_of_cells
from motion_detect_ros.core.geometry.order_statistics import median
from motion_detect_ros.core.geometry.robust import MAD_TO_SIGMA, RAYLEIGH_MEDIAN
from motion_detect_ros.core.geometry.warp import inverse
from motion_detect_ros.core.kernels import kernel
from motion_detect_ros.core.trajectories.local_noise import PointGrid
from motion_detect_ros.core.trajectories.parallax import back_by_travel, fitted_homography, without_parallax
from motion_detect_ros.core.trajectories.plane_background import plane_is_better, plane_motion
from motion_detect_ros.core.trajectories.points import Points
from motion_detect_ros.core.trajectories.recent_frames import RecentFrames
from motion_detect_ros.core.trajectories.relief import EpipolarParts, epipolar_parts
from motion_detect_ros.core.types import CameraModel, DoubleArray

#: Background and noise are taken from one point in each cell of this size, share of the image width (24 of 960 pixels):
#: points are dense on what moves.
SAMPLE_CELL_SHARE = 0.025
#: Noise of a displacement: floor, pixels (of the point tracker), share of the background's motion beyond the
#: ego-motion, share of the camera-caused flow.
NOISE_FLOOR_PX, BACKGROUND_SHARE, CAMERA_SHARE = 0.12, 0.03, 0.01
#: Errors of points have wider tails than their median says; least deviation, pixels.
WIDE_TAILS, LEAST_SIGMA_PX = MAD_TO_SIGMA, 1e-3
#: Noise along the epipolar lines of a scene in relief.
RELIEF_NOISE = 2.5


@dataclass(frozen=True)
class Displacements:
    """Of N points over B baselines. ``motion``, ``background``: (B, N, 2), ``noise``: (B, N), pixels, and ``sigmas``:
    (B, N). Of points younger than a baseline ``motion`` is NaN, and the others are not set.
    """

    motion: DoubleArray
    background: DoubleArray
    noise: DoubleArray
    sigmas: DoubleArray

    @classmethod
    def of(cls, baselines: int, points: int) -> Displacements:
        """None of them known yet."""
        return cls(np.full((baselines, points, 2), np.nan), np.empty((baselines, points, 2)),
                   np.empty((baselines, points)), np.empty((baselines, points)))


class Baseline:
    """The points that are as old as a baseline. ``error``: (n, 2) what the background does not explain, pixels."""

    def __init__(self, points: Points, frames: RecentFrames, ago: int) -> None:
        self.frames, self.seconds = ago, frames.seconds(ago)
        self._height, self._width = frames[0].gray.shape
        self._matrix = frames[ago].matrix
        self._old: npt.NDArray[np.intp] = np.flatnonzero(points.age >= ago)
        self._now, self._earlier = np.empty((2, len(self), 2), np.float32)
        self._carried, self.error = np.empty((2, len(self), 2))
        _residuals(points.path, self._old, ago, self._matrix.astype(np.float32), self._now, self._earlier,
                   self._carried, self.error)
        self._background, self._has_plane = np.zeros((len(self), 2)), False
        self._sample = first_of_cells(self._now, SAMPLE_CELL_SHARE * self._width, self._width, self._height)

    def __len__(self) -> int:
        return len(self._old)

    def plane_is_better(self) -> bool:
        """Than the chained ego-motion."""
        return plane_is_better(self._now[self._sample], self.error[self._sample], self._width, self._height)

    def use_plane(self) -> None:
        """Its motion is the background's from now on."""
        self._background = plane_motion(self._now[self._sample], self.error[self._sample], self._now, self._width,
                                        self._height)
        self._has_plane = True
        self.error -= self._background

    def epipolar_parts(self) -> EpipolarParts:
        """Of the errors."""
        return epipolar_parts(self._now, self.error, self._sample, self._width, self._height)

    def measure(self, camera: CameraModel, parts: EpipolarParts | None, of: Displacements, index: int) -> None:
        """Fills the baseline ``index`` of ``of``. parts: of a scene in relief, None = it is none."""
        unexplained, of_parallax = np.empty((2, len(self)))
        back = back_by_travel(self._homography(), self._earlier, camera)
        without_parallax(self._now, self.error, back, unexplained, of_parallax)
        sigma_px = max(LEAST_SIGMA_PX, WIDE_TAILS * (median(unexplained[self._sample]) / RAYLEIGH_MEDIAN))
        grid = PointGrid(self._now, self._width, self._height)
        _significance(
            self._old, self._now, inverse(self._matrix).astype(np.float32), self.error, self._background, unexplained,
            of_parallax, grid.local_sigma(unexplained, sigma_px), _with_sigmas(parts, grid), of.motion[index],
            of.background[index], of.noise[index], of.sigmas[index])

    def _homography(self) -> DoubleArray | None:
        """Of the background plane."""
        if not self._has_plane:
            return self._matrix
        return fitted_homography(self._earlier, self._carried + self._background)


def _with_sigmas(parts: EpipolarParts | None, grid: PointGrid) -> DoubleArray:
    """(4, n) parts along and across epipolar lines, and the sigmas of both around each point; (4, 0) for None."""
    if parts is None:
        return np.empty((4, 0))
    return np.stack([parts.along, parts.across, grid.local_sigma(parts.along, parts.along_sigma),
                     grid.local_sigma(parts.across, parts.across_sigma)])


@kernel(error_model='numpy')
def _residuals(path, old, ago, matrix, now, earlier, carried, residual):  # type: ignore[no-untyped-def]
    """``now``, ``earlier``: (n, 2) positions of the ``old`` points, ``carried``: where the ego-motion takes them, and
    ``residual`` against that; pixels. path: (N, MAX_FRAMES, 2); matrix: (3, 3) float32, from ``ago`` frames ago.
    """
    m = matrix
    for n in range(len(old)):
        x, y = path[old[n], ago, 0], path[old[n], ago, 1]
        depth = m[2, 0] * x + m[2, 1] * y + m[2, 2]
        earlier[n, 0], earlier[n, 1] = x, y
        carried[n, 0] = (m[0, 0] * x + m[0, 1] * y + m[0, 2]) / depth
        carried[n, 1] = (m[1, 0] * x + m[1, 1] * y + m[1, 2]) / depth
        for axis in range(2):
            now[n, axis] = path[old[n], 0, axis]
            residual[n, axis] = now[n, axis] - carried[n, axis]


@kernel(error_model='numpy')
def _significance(  # type: ignore[no-untyped-def]
    old, now, back, error, background, unexplained, of_parallax, local_sigma, parts, motion_out, background_out,
    noise_out, sigmas_out,
):
    """Writes motion, background, noise and significance of the ``old`` points (n,) to those of all N.

    now, error, background: (n, 2), the others (n,), pixels; back: (3, 3) float32, the ego-motion back to the start of
    the baseline; parts: ``_with_sigmas``. In relief the noise along the epipolar lines is larger, and counts.
    """
    m = back
    for n in range(len(old)):
        x, y, point = now[n, 0], now[n, 1], old[n]
        depth = m[2, 0] * x + m[2, 1] * y + m[2, 2]
        flow_x = x - (m[0, 0] * x + m[0, 1] * y + m[0, 2]) / depth
        flow_y = y - (m[1, 0] * x + m[1, 1] * y + m[1, 2]) / depth
        u, v = background[n, 0], background[n, 1]
        shared = (BACKGROUND_SHARE * math.sqrt(u * u + v * v)
                  + CAMERA_SHARE * math.sqrt(flow_x * flow_x + flow_y * flow_y))
        noise = _noise(local_sigma[n]) + shared + of_parallax[n]
        sigmas = unexplained[n] / noise
        if n < parts.shape[1]:
            across_noise = _noise(parts[3, n]) + shared
            along_noise = max(_noise(RELIEF_NOISE * parts[2, n]) + shared, across_noise)
            along, across = parts[0, n] / along_noise, parts[1, n] / across_noise
            sigmas = min(sigmas, math.sqrt(along * along + across * across))
        motion_out[point, 0], motion_out[point, 1] = error[n, 0], error[n, 1]
        background_out[point, 0], background_out[point, 1] = u, v
        noise_out[point], sigmas_out[point] = noise, sigmas


@kernel()
def _noise(sigma):  # type: ignore[no-untyped-def]
    """With the floor; pixels."""
    return math.sqrt(sigma * sigma + NOISE_FLOOR_PX * NOISE_FLOOR_PX)
