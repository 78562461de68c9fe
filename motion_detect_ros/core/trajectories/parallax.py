"""What static points at other depths than the background plane may do: plane and parallax, and scenes in relief."""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np
import numpy.typing as npt

from motion_detect_ros.core.geometry.robust import MAD_TO_SIGMA
from motion_detect_ros.core.geometry.vectors import magnitude
from motion_detect_ros.core.geometry.warp import inverse
from motion_detect_ros.core.types import CameraModel, DoubleArray, FloatArray

#: Points that the plane's homography is taken from.
HOMOGRAPHY_POINTS = 200
#: Share of the points in front of the camera, for a decomposition to be possible; and the normal that a ground has,
#: camera's axes: down and ahead.
IN_FRONT_SHARE, GROUND_NORMAL = 0.9, np.array([0.0, 0.6, 0.8])
#: Parallax of a static point, share of the plane's own shift: a little below the ground to twice as close as it; and
#: its noise, share of the parallax.
LEAST_PARALLAX, MOST_PARALLAX, PARALLAX_NOISE_SHARE = -0.05, 0.5, 0.1
#: The common epipole: rounds of re-weighting, points used, percentile of the lengths from which they count, errors over
#: so many deviations do not count, least deviation (normalised, and of a length in pixels).
EPIPOLE_ROUNDS, EPIPOLE_POINTS, SHORT_PERCENTILE, OUTLIER_SIGMAS, LEAST_SIGMA, LEAST_PX = 8, 1000, 30.0, 6.0, 0.02, 1e-3


def plane_shift(
    earlier: FloatArray, moved: DoubleArray, places: FloatArray, camera: CameraModel,
) -> DoubleArray | None:
    """(n, 2) how far the background plane moves at ``places`` because the camera travels, pixels; rotation excluded.

    earlier, moved: (N, 2) points of the plane and where it takes them; places: (n, 2) in the current image; camera: of
    this resolution. A static point above the plane moves by a share of it more. None where there is no such plane.
    Source: Malis and Vargas 2007 (decomposition); Irani and Anandan 1996 (plane and parallax).
    """
    chosen = slice(None, None, max(1, len(earlier) // HOMOGRAPHY_POINTS))
    homography, _ = cv2.findHomography(earlier[chosen].astype(np.float64), moved[chosen], 0)
    if homography is None or not np.isfinite(homography).all() or abs(np.linalg.det(homography)) < 1e-9:
        return None
    matrix = camera.matrix
    to_ray = inverse(matrix)
    rays = _homogeneous(earlier[chosen]) @ to_ray.T
    rotation = _rotation(homography, matrix, rays)
    if rotation is None:
        return None
    turned = _homogeneous(places) @ (matrix @ rotation @ to_ray @ inverse(homography)).T
    shift: DoubleArray = places - turned[:, :2] / turned[:, 2:]
    return shift


def _rotation(homography: DoubleArray, matrix: DoubleArray, rays: DoubleArray) -> DoubleArray | None:
    """The rotation of the solution whose plane is most like a ground, all points in front of the camera."""
    _, rotations, _, normals = cv2.decomposeHomographyMat(homography, matrix)
    likely = [(float(normal[:, 0] @ GROUND_NORMAL), index) for index, normal in enumerate(normals)
              if (rays @ normal[:, 0] > 0.0).mean() >= IN_FRONT_SHARE]
    return np.asarray(rotations[max(likely)[1]], np.float64) if likely else None


def _homogeneous(points: FloatArray) -> DoubleArray:
    return np.column_stack([points, np.ones(len(points))]).astype(np.float64)


def without_parallax(error: DoubleArray, shift: DoubleArray) -> tuple[DoubleArray, DoubleArray]:
    """What parallax along ``shift`` does not explain of ``error``, both (N, 2) pixels; and (N,) its noise, pixels."""
    squared = (shift * shift).sum(axis=1) + 1e-6
    share = np.clip((error * shift).sum(axis=1) / squared, LEAST_PARALLAX, MOST_PARALLAX)
    explained = share[:, None] * shift
    return error - explained, PARALLAX_NOISE_SHARE * magnitude(explained)


@dataclass(frozen=True)
class EpipolarParts:
    """Residuals along and across the lines to their common epipole: (N,) pixels, and their robust deviations."""

    along: DoubleArray
    across: DoubleArray
    along_sigma: float
    across_sigma: float

    @property
    def relief(self) -> float:
        """How much longer residuals are along the lines: about 1 on a plane, 2 and more in a street."""
        return self.along_sigma / self.across_sigma


def epipolar_parts(
    points: FloatArray, error: DoubleArray, sample: npt.NDArray[np.intp], width: int, height: int,
) -> EpipolarParts:
    """points, error: (N, 2) pixels; sample: (n,) indices of those that epipole and deviations are taken from."""
    x, y = ((points.astype(np.float64) - [width / 2.0, height / 2.0]) / (width / 2.0)).T
    a, b, c = _epipole(x[sample], y[sample], error[sample])
    towards = np.stack([a - c * x, b - c * y], axis=1)
    towards /= np.maximum(magnitude(towards), 1e-6)[:, None]
    along = (error * towards).sum(axis=1)
    across = error[:, 1] * towards[:, 0] - error[:, 0] * towards[:, 1]
    across_sigma = max(LEAST_PX, MAD_TO_SIGMA * float(np.median(np.abs(across[sample]))))
    along_sigma = max(across_sigma, MAD_TO_SIGMA * float(np.median(np.abs(along[sample]))))
    return EpipolarParts(along, across, along_sigma, across_sigma)


def _epipole(x: DoubleArray, y: DoubleArray, error: DoubleArray) -> DoubleArray:
    """(3,) homogeneous (a, b, c): residuals point from (x, y) to (a, b) / c or away from it. Robust (IRLS)."""
    length = magnitude(error)
    used = np.flatnonzero(length > np.percentile(length, SHORT_PERCENTILE))
    used = used[::max(1, len(used) // EPIPOLE_POINTS)]
    x, y, error, length = x[used], y[used], error[used], np.maximum(length[used], LEAST_PX)
    lines = np.stack([error[:, 1], -error[:, 0], error[:, 0] * y - error[:, 1] * x], axis=1)
    weight = 1.0 / length
    epipole = np.array([0.0, 0.0, 1.0])
    for _ in range(EPIPOLE_ROUNDS):
        weighted = lines * weight[:, None]
        epipole = np.linalg.eigh(weighted.T @ weighted)[1][:, 0]
        reach = np.hypot(epipole[0] - epipole[2] * x, epipole[1] - epipole[2] * y) + 1e-6
        off = np.abs(lines @ epipole) / reach
        sigma = max(LEAST_SIGMA, MAD_TO_SIGMA * float(np.median(off)))
        weight = 1.0 / (reach * np.sqrt(np.maximum(1.0, off / sigma)) * np.sqrt(np.maximum(length, sigma)))
        weight = np.where(off < OUTLIER_SIGMAS * sigma, weight, 0.0)
    return np.asarray(epipole, np.float64)
