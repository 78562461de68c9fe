"""The camera's motion through a static scene: rotation and direction of travel, from point correspondences.

A static point seen at q in the earlier frame appears, once the camera's rotation R is taken out, on the half-line from
p0 = R q (infinitely far) towards the epipole: p(s) = p0 + s (t_xy - t_z p0), s >= 0, in normalised coordinates
(Longuet-Higgins 1981; Hartley and Zisserman 2003, section 9.6). s grows with inverse depth.
"""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np

from motion_detect_ros.core.types import CameraModel, DoubleArray, FloatArray

#: Correspondences used at most, and needed at least.
MAX_SAMPLES, MIN_SAMPLES = 1500, 60
#: Distance to the epipolar line up to which a correspondence agrees with the motion, pixels.
INLIER_PX = 1.0
#: Share of agreeing correspondences from which the refined motion of the last frame is good enough as a start.
TRUSTED_SHARE = 0.7
#: Re-weighting rounds, Tukey's constant, and the smallest deviation the weights assume, pixels.
REFINE_ROUNDS, TUKEY_C, MIN_SIGMA_PX = 8, 4.685, 0.15
#: Step of the numerical derivative, radians.
STEP_RAD = 1e-6


@dataclass(frozen=True)
class CameraMotion:
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
        """The s of the place on each line that is closest to ``points``; negative = nowhere in front of the camera."""
        length = np.maximum((self.towards ** 2).sum(axis=-1), 1e-12)
        s: DoubleArray = ((points - self.far) * self.towards).sum(axis=-1) / length
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
        """(..., 2) the place itself."""
        place: DoubleArray = self.far + s[..., None] * self.towards
        return place


def normalised(points: FloatArray, camera: CameraModel) -> DoubleArray:
    """(..., 2) pixels -> coordinates on the image plane at distance one."""
    out: DoubleArray = (points - np.array([camera.cx, camera.cy])) / np.array([camera.fx, camera.fy])
    return out


def epipolar_lines(earlier: DoubleArray, motion: CameraMotion) -> EpipolarLines:
    """The lines of points seen at ``earlier`` (..., 2) normalised."""
    turned = earlier @ motion.rotation[:, :2].T + motion.rotation[:, 2]
    far = turned[..., :2] / turned[..., 2:]
    t = motion.direction
    return EpipolarLines(far, t[:2] - t[2] * far, turned[..., 2], float(t[2]))


def estimate_motion(
    earlier: DoubleArray, current: DoubleArray, focal_px: float, start: CameraMotion | None = None,
) -> CameraMotion | None:
    """Rotation and direction that the most correspondences agree with; None with too few of them.

    earlier, current: (N, 2) normalised. ``start``, the motion of the frame before, saves the search where it leads to
    enough agreement; else the essential matrix by RANSAC with MAGSAC++ scoring (Nister 2004; Barath et al. 2020).
    """
    step = max(1, len(earlier) // MAX_SAMPLES)
    q, p = earlier[::step], current[::step]
    if len(q) < MIN_SAMPLES:
        return None
    if start is not None:
        refined = refine_motion(q, p, start, focal_px)
        if refined.inlier_share >= TRUSTED_SHARE:
            return refined
    found = _ransac(q, p, focal_px)
    return None if found is None else refine_motion(q, p, found, focal_px)


def _ransac(q: DoubleArray, p: DoubleArray, focal_px: float) -> CameraMotion | None:
    cv2.setRNGSeed(0)
    essential, mask = cv2.findEssentialMat(q, p, np.eye(3), cv2.USAC_MAGSAC, 0.999, INLIER_PX / focal_px)
    if essential is None or essential.shape != (3, 3):
        return None
    _, rotation, direction, _ = cv2.recoverPose(essential, q, p, np.eye(3), mask=mask.copy())
    return CameraMotion(rotation, direction.ravel(), 0.0)


def refine_motion(q: DoubleArray, p: DoubleArray, start: CameraMotion, focal_px: float) -> CameraMotion:
    """Gauss-Newton on the five parameters, Tukey-weighted distances to the epipolar lines (IRLS)."""
    rotation, direction = start.rotation, start.direction
    for _ in range(REFINE_ROUNDS):
        error = _line_distance(q, p, rotation, direction)
        jacobian = np.stack([
            (_line_distance(q, p, *_moved(rotation, direction, small)) - error) / STEP_RAD
            for small in STEP_RAD * np.eye(5)], axis=1)
        sigma = max(MIN_SIGMA_PX / focal_px, 1.4826 * float(np.median(np.abs(error))))
        weight = np.clip(1.0 - (error / (TUKEY_C * sigma)) ** 2, 0.0, None) ** 2
        weighted = jacobian * weight[:, None]
        step = -np.asarray(np.linalg.solve(weighted.T @ jacobian + 1e-9 * np.eye(5), weighted.T @ error), np.float64)
        rotation, direction = _moved(rotation, direction, step)
        if np.abs(step).max() < STEP_RAD:
            break
    agreeing = np.abs(_line_distance(q, p, rotation, direction)) * focal_px < INLIER_PX
    motion = CameraMotion(rotation, direction, float(agreeing.mean()))
    if np.median(epipolar_lines(q, motion).position(p)) < 0.0:
        motion = CameraMotion(rotation, -direction, motion.inlier_share)
    return motion


def _line_distance(q: DoubleArray, p: DoubleArray, rotation: DoubleArray, direction: DoubleArray) -> DoubleArray:
    """(N,) signed distance of p to its epipolar line, normalised units."""
    lines = epipolar_lines(q, CameraMotion(rotation, direction, 0.0))
    away, v = p - lines.far, lines.towards
    distance: DoubleArray = (away[:, 0] * v[:, 1] - away[:, 1] * v[:, 0]) / np.sqrt((v * v).sum(axis=1) + 1e-6)
    return distance


def _moved(rotation: DoubleArray, direction: DoubleArray, step: DoubleArray) -> tuple[DoubleArray, DoubleArray]:
    """A small turn (step[:3], radians) of the camera and tilt (step[3:]) of the direction."""
    helper = np.eye(3)[int(np.argmin(np.abs(direction)))]
    one = np.cross(direction, helper)
    one /= np.linalg.norm(one)
    tilted = direction + step[3] * one + step[4] * np.cross(direction, one)
    turned: DoubleArray = cv2.Rodrigues(step[:3])[0] @ rotation
    return turned, tilted / np.linalg.norm(tilted)
