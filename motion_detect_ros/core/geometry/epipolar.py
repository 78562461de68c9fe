"""The camera's motion through a static scene: rotation and direction of travel, from point correspondences.

A static point seen at q in the earlier frame appears, once the camera's rotation R is taken out, on the half-line from
p0 = R q (infinitely far) towards the epipole: p(s) = p0 + s (t_xy - t_z p0), s >= 0, in normalised coordinates
(Longuet-Higgins 1981; Hartley and Zisserman 2004, section 9.6). s grows with inverse depth.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import NamedTuple

import cv2
import numpy as np

from motion_detect_ros.core.geometry.normal_equations import tukey_sums
from motion_detect_ros.core.geometry.order_statistics import median
from motion_detect_ros.core.geometry.robust import MAD_TO_SIGMA, TUKEY_C
from motion_detect_ros.core.kernels import kernel
from motion_detect_ros.core.types import BoolArray, CameraModel, DoubleArray, FloatArray

#: Maximum and minimum number of correspondences.
MAX_SAMPLES, MIN_SAMPLES = 1500, 60
#: Distance to the epipolar line up to which a correspondence agrees with the motion, pixels.
INLIER_PX = 1.0
#: Share of inliers from which the refined motion of the last frame is accepted without RANSAC.
TRUSTED_SHARE = 0.7
#: Re-weighting rounds, and the smallest deviation the weights assume, pixels.
REFINE_ROUNDS, MIN_SIGMA_PX = 8, 0.15
#: Steps below this end the rounds, radians; added to the squared length of a line's direction, which may be zero.
SMALL_RAD, LENGTH_FLOOR = 1e-6, 1e-6
#: Added to the diagonal of the normal equations: without parallax the direction is not determined.
RIDGE = 1e-9


@dataclass(frozen=True)
class PoseEstimate:
    """``rotation``: (3, 3), earlier camera -> current camera; ``direction``: (3,) unit vector, X_now = R X + t.

    ``inlier_share``: of the samples that lie within ``INLIER_PX`` of their epipolar line.
    """

    rotation: DoubleArray
    direction: DoubleArray
    inlier_share: float


@dataclass(frozen=True)
class EpipolarLines:
    """Where a static point may appear: ``far + s * towards``, s >= 0, all (..., 2) in normalised coordinates.

    ``depth``: (...,) third component of R (q, 1), which turns s into inverse depth.
    """

    far: DoubleArray
    towards: DoubleArray
    depth: DoubleArray
    direction_z: float

    def position(self, points: DoubleArray) -> DoubleArray:
        """The s of the place on each line that is closest to ``points``; negative = behind the camera."""
        vx, vy = self.towards[..., 0], self.towards[..., 1]
        away = points - self.far
        s: DoubleArray = (away[..., 0] * vx + away[..., 1] * vy) / np.maximum(vx * vx + vy * vy, 1e-12)
        return s

    def inverse_depth(self, s: DoubleArray) -> DoubleArray:
        """1 / depth in the earlier camera, in units of 1 / distance travelled."""
        inverse: DoubleArray = s * self.depth / np.maximum(1.0 - s * self.direction_z, 1e-3)
        return inverse


def normalised(points: FloatArray, camera: CameraModel) -> DoubleArray:
    """(..., 2) pixels -> coordinates on the image plane at distance one."""
    out = np.empty(points.shape)
    out[..., 0] = (points[..., 0] - np.float64(camera.cx)) / camera.fx
    out[..., 1] = (points[..., 1] - np.float64(camera.cy)) / camera.fy
    return out


def epipolar_lines(earlier: DoubleArray, motion: PoseEstimate) -> EpipolarLines:
    """The lines of points seen at ``earlier`` (..., 2) normalised."""
    turned = earlier @ motion.rotation[:, :2].T + motion.rotation[:, 2]
    far = turned[..., :2] / turned[..., 2:]
    t = motion.direction
    return EpipolarLines(far, t[:2] - t[2] * far, turned[..., 2], float(t[2]))


def estimate_pose(
    earlier: DoubleArray, current: DoubleArray, known: BoolArray, focal_px: float, start: PoseEstimate | None = None,
) -> PoseEstimate | None:
    """Rotation and direction that the most correspondences agree with; None with too few of them.

    earlier, current: (..., 2) normalised; known: (...,) which of them count. ``start``, the motion of the frame before,
    saves the search where it leads to enough agreement; else the essential matrix by RANSAC with MAGSAC++ scoring
    (Nister 2004; Barath et al. 2020).
    """
    used = np.flatnonzero(known)
    used = used[::max(1, -(-used.size // MAX_SAMPLES))]
    q, p = earlier.reshape(-1, 2)[used], current.reshape(-1, 2)[used]
    if len(q) < MIN_SAMPLES:
        return None
    if start is not None:
        refined = refine_pose(q, p, start, focal_px)
        if refined.inlier_share >= TRUSTED_SHARE:
            return refined
    found = _ransac(q, p, focal_px)
    return None if found is None else refine_pose(q, p, found, focal_px)


def _ransac(q: DoubleArray, p: DoubleArray, focal_px: float) -> PoseEstimate | None:
    """Of the two turns that an essential matrix stands for, half a turn about the way apart, the small one.

    Which points lie in front of the camera tells them apart only where these are near.
    """
    essential, _ = cv2.findEssentialMat(q, p, np.eye(3), cv2.USAC_MAGSAC, 0.999, INLIER_PX / focal_px)
    if essential is None or essential.shape != (3, 3):
        return None
    *turns, direction = cv2.decomposeEssentialMat(essential)
    return PoseEstimate(max(turns, key=np.trace), direction.ravel(), 0.0)


def refine_pose(q: DoubleArray, p: DoubleArray, start: PoseEstimate, focal_px: float) -> PoseEstimate:
    """Gauss-Newton on the five parameters, Tukey-weighted distances to the epipolar lines (IRLS)."""
    q, p = np.ascontiguousarray(q), np.ascontiguousarray(p)
    distance, slope = np.empty(len(q)), np.empty((len(q), 5))
    pose, least_sigma = _Pose(start.rotation, start.direction), MIN_SIGMA_PX / focal_px
    for _ in range(REFINE_ROUNDS):
        tilts = _tilts(pose.direction)
        _linearise(q, p, *pose, tilts, distance, slope)
        step = _step(distance, slope, least_sigma)
        if np.abs(step).max() < SMALL_RAD:
            break
        pose = pose.stepped(step, tilts)
    else:
        _linearise(q, p, *pose, _tilts(pose.direction), distance, slope)
    share = np.count_nonzero(np.abs(distance) * focal_px < INLIER_PX) / len(q)
    motion = PoseEstimate(*pose, share)
    if median(epipolar_lines(q, motion).position(p)) < 0.0:
        motion = PoseEstimate(pose.rotation, -pose.direction, share)
    return motion


def _step(distance: DoubleArray, slope: DoubleArray, least_sigma: float) -> DoubleArray:
    """(5,) of the parameters, by least squares with Tukey's weights.

    distance: (N,), slope: (N, 5), see ``_linearise``; least_sigma: of the distances, normalised.
    """
    normal, right = np.empty((5, 5)), np.empty(5)
    bound = TUKEY_C * max(least_sigma, MAD_TO_SIGMA * median(np.abs(distance)))
    tukey_sums(slope, distance, bound, normal, right)
    normal.flat[::6] += RIDGE
    return -np.asarray(np.linalg.solve(normal, right), np.float64)


class _Pose(NamedTuple):
    """Rotation (3, 3) and direction of travel (3,), a unit vector."""

    rotation: DoubleArray
    direction: DoubleArray

    def stepped(self, step: DoubleArray, tilts: DoubleArray) -> _Pose:
        """step: (5,) three angles of a small turn, two ``tilts`` of the direction, radians."""
        direction = self.direction + step[3:] @ tilts
        turn = np.asarray(cv2.Rodrigues(step[:3])[0], np.float64)
        return _Pose(turn @ self.rotation, direction / math.sqrt(direction @ direction))


def _tilts(direction: DoubleArray) -> DoubleArray:
    """(2, 3) two ways to tilt a unit vector, at right angles to it and to each other."""
    x, y, z = direction.tolist()
    a, b, c = (0.0, z, -y) if abs(x) < 0.6 else (-z, 0.0, x)
    length = math.hypot(a, b, c)
    a, b, c = a / length, b / length, c / length
    return np.array([[a, b, c], [y * c - z * b, z * a - x * c, x * b - y * a]])


@kernel(error_model='numpy')
def infinitely_far(x, y, rotation):  # type: ignore[no-untyped-def]
    """The place p0 = R q of a point q = (x, y) and the third component of R (q, 1), by which it is divided."""
    depth = rotation[2, 0] * x + rotation[2, 1] * y + rotation[2, 2]
    return ((rotation[0, 0] * x + rotation[0, 1] * y + rotation[0, 2]) / depth,
            (rotation[1, 0] * x + rotation[1, 1] * y + rotation[1, 2]) / depth, depth)


@kernel(error_model='numpy')
def _linearise(q, p, rotation, direction, tilts, distance, slope):  # type: ignore[no-untyped-def]
    """``distance``: (N,) of p from its epipolar line, signed, normalised units; ``slope``: (N, 5) its derivative.

    The derivative is by a small turn of the camera (three angles, radians) and by the two ``tilts`` of the direction.
    With f = (far, 1) the distance is f . (p x t) over the length of the line's direction vector v.
    """
    x, y, z = direction[0], direction[1], direction[2]
    for n in range(len(q)):
        px, py = p[n, 0], p[n, 1]
        fx, fy, _ = infinitely_far(q[n, 0], q[n, 1], rotation)
        vx, vy = x - z * fx, y - z * fy
        gx, gy, gz = z * py - y, x - z * px, y * px - x * py  # p x t
        area, squared = fx * gx + fy * gy + gz, vx * vx + vy * vy + LENGTH_FLOOR
        per_length = 1.0 / squared ** 0.5
        away = area * per_length
        stretch = away / squared
        distance[n] = away
        slope[n, 0] = (fy * gz - gy - area * fy) * per_length - z * (vx * fx * fy + vy * (1.0 + fy * fy)) * stretch
        slope[n, 1] = (gx - fx * gz + area * fx) * per_length + z * (vx * (1.0 + fx * fx) + vy * fx * fy) * stretch
        slope[n, 2] = (fx * gy - fy * gx) * per_length + z * (vy * fx - vx * fy) * stretch
        for k in range(2):
            a, b, c = tilts[k, 0], tilts[k, 1], tilts[k, 2]
            slope[n, 3 + k] = ((a * (fy - py) + b * (px - fx) + c * (fx * py - fy * px)) * per_length
                               - (a * vx + b * vy - c * (vx * fx + vy * fy)) * stretch)
