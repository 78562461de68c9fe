"""The camera's motion through a static scene: rotation and direction of travel, from point correspondences.

A static point seen at q in the earlier frame appears, once the camera's rotation R is taken out, on the half-line from
p0 = R q (infinitely far) towards the epipole: p(s) = p0 + s (t_xy - t_z p0), s >= 0, in normalised coordinates
(Longuet-Higgins 1981; Hartley and Zisserman 2004, section 9.6). s grows with inverse depth.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import cv2
import numpy as np

from motion_detect_ros.core.geometry.robust import MAD_TO_SIGMA, reweighted, tukey_weights
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

    def from_inverse_depth(self, inverse: DoubleArray) -> DoubleArray:
        """The s of a point of known inverse depth."""
        s: DoubleArray = inverse / np.maximum(self.depth + inverse * self.direction_z, 1e-6)
        return s

    def at(self, s: DoubleArray) -> DoubleArray:
        """(..., 2) the point on each line at ``s``."""
        place: DoubleArray = self.far + s[..., None] * self.towards
        return place


def normalised(points: FloatArray, camera: CameraModel) -> DoubleArray:
    """(..., 2) pixels -> coordinates on the image plane at distance one."""
    out: DoubleArray = (points - np.array([camera.cx, camera.cy])) / np.array([camera.fx, camera.fy])
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
    jacobian: DoubleArray = np.empty((5, len(q)))

    def errors(pose: _Pose) -> DoubleArray:
        nonlocal jacobian
        error, jacobian = _linearised(q, p, pose.rotation, pose.direction, _tilts(pose.direction))
        return error

    def weights(error: DoubleArray) -> DoubleArray:
        return tukey_weights(error, max(MIN_SIGMA_PX / focal_px, MAD_TO_SIGMA * float(np.median(np.abs(error)))))

    def solve(pose: _Pose, error: DoubleArray, weights: DoubleArray) -> _Pose | None:
        weighted = jacobian * weights
        step = -np.asarray(np.linalg.solve(weighted @ jacobian.T + 1e-9 * np.eye(5), weighted @ error), np.float64)
        return None if np.abs(step).max() < SMALL_RAD else pose.stepped(step)

    rotation, direction = reweighted(_Pose(start.rotation, start.direction), errors, weights, solve, REFINE_ROUNDS)
    agreeing = np.abs(_linearised(q, p, rotation, direction, _tilts(direction))[0]) * focal_px < INLIER_PX
    motion = PoseEstimate(rotation, direction, float(agreeing.mean()))
    if np.median(epipolar_lines(q, motion).position(p)) < 0.0:
        motion = PoseEstimate(rotation, -direction, motion.inlier_share)
    return motion


class _Pose(NamedTuple):
    """Rotation (3, 3) and direction of travel (3,), a unit vector."""

    rotation: DoubleArray
    direction: DoubleArray

    def stepped(self, step: DoubleArray) -> _Pose:
        """step: (5,) three angles of a small turn, two tilts of the direction, radians."""
        direction = self.direction + step[3:] @ _tilts(self.direction)
        turn = np.asarray(cv2.Rodrigues(step[:3])[0], np.float64)
        return _Pose(turn @ self.rotation, direction / np.linalg.norm(direction))


def _tilts(direction: DoubleArray) -> DoubleArray:
    """(2, 3) two ways to tilt a unit vector, at right angles to it and to each other."""
    x, y, z = direction
    one = np.array([0.0, z, -y] if abs(x) < 0.6 else [-z, 0.0, x])
    one /= np.linalg.norm(one)
    return np.stack([one, np.cross(direction, one)])


def _linearised(
    q: DoubleArray, p: DoubleArray, rotation: DoubleArray, direction: DoubleArray, tilts: DoubleArray,
) -> tuple[DoubleArray, DoubleArray]:
    """(N,) signed distance of p to its epipolar line, normalised units, and (5, N) its derivative.

    The derivative is by a small turn of the camera (three angles, radians) and by the two ``tilts`` of the direction.
    With f = (far, 1) the distance is f . (p x t) over the length of the line's direction vector v.
    """
    (x, y, z), (px, py) = direction, p.T
    fx, fy, depth = rotation[:, :2] @ q.T + rotation[:, 2:]
    fx, fy = fx / depth, fy / depth
    vx, vy = x - z * fx, y - z * fy
    gx, gy, gz = z * py - y, x - z * px, y * px - x * py  # p x t
    area = fx * gx + fy * gy + gz
    per_turn = np.stack([fy * gz - gy - area * fy, gx - fx * gz + area * fx, fx * gy - fy * gx])
    per_tilt = tilts @ np.stack([fy - py, px - fx, fx * py - fy * px])
    stretch_turn = -z * np.stack([-vx * fx * fy - vy * (1.0 + fy * fy), vx * (1.0 + fx * fx) + vy * fx * fy,
                                  vy * fx - vx * fy])
    stretch_tilt = tilts @ np.stack([vx, vy, -vx * fx - vy * fy])
    squared = vx * vx + vy * vy + LENGTH_FLOOR
    distance = area / np.sqrt(squared)
    slope = np.concatenate([per_turn, per_tilt]) / np.sqrt(squared)
    slope -= np.concatenate([stretch_turn, stretch_tilt]) * (distance / squared)
    return distance, slope
