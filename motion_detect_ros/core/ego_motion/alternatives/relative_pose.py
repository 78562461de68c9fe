"""Relative pose of the camera from the tracks of one pair of frames: rotation, direction, epipole and ground.

A rotation moves points independently of their depth; the direction of travel is observable only in the parallax that
is left. Where the parallax does not clearly exceed the tracks' noise there is no estimate.

Plane: from a drone the ground often fills the image. In a narrow view sideways travel over it looks like a rotation.
With more perspective two motions explain every track equally well, with the plane's normal and the direction of travel
exchanged (Longuet-Higgins 1986). Both are compared on all tracks, and there is an estimate only where points off the
plane (a fifth of the tracks in the tests) decide between them. So flat ground alone gives none.
"""

from __future__ import annotations

import cv2
import numpy as np

from motion_detect_ros.core.geometry.distortion import distorted, undistorted
from motion_detect_ros.core.geometry.epipolar import (
    INLIER_PX,
    MIN_SAMPLES,
    PoseEstimate,
    epipolar_lines,
    estimate_pose,
    refine_pose,
)
from motion_detect_ros.core.geometry.ground_plane import ground_below
from motion_detect_ros.core.geometry.robust import MAD_TO_SIGMA, reweighted, tukey_weights
from motion_detect_ros.core.types import CameraModel, DoubleArray, FloatArray, RelativePose

#: Least share of the tracks on their epipolar lines: else there is no common motion.
MIN_INLIER_SHARE = 0.5
#: Least residual of the rotation that is parallax, deviations of its noise; smallest deviation, pixels.
PARALLAX_SIGMAS, MIN_SIGMA_PX = 4.0, 0.1
#: Least share of the tracks with parallax; one or two movers before a rotating camera stay below it.
MIN_PARALLAX_SHARE = 0.3
#: Distances from the epipolar line are truncated here in the comparison of motions, pixels.
CLEARLY_OFF_PX = 0.5
#: A motion fits as well as the best up to this multiple of its mean distance, and this much more in pixels ...
RIVAL_SHARE, RIVAL_PX = 1.1, 0.005
#: ... and is a different one where the cosine between the directions is under this (10 degrees).
SAME_DIRECTION = 0.985
#: Re-weighting rounds of the rotation alone.
ROUNDS = 7


class RelativePoseEstimator:
    """Estimates the relative pose; keeps that of the last frame as the initial guess."""

    def __init__(self, focal_share: float) -> None:
        """focal_share: focal length where no calibration is known, share of the image width."""
        self._focal_share = focal_share
        self._last: PoseEstimate | None = None

    def reset(self) -> None:
        """Clear the last frame's motion."""
        self._last = None

    def estimate(
        self, earlier: FloatArray, current: FloatArray, width: int, height: int, camera: CameraModel | None,
    ) -> RelativePose | None:
        """None where the tracks do not determine the motion: too few, no common motion, too little parallax.

        earlier, current: (N, 2) full-resolution pixels of a ``width`` x ``height`` image; camera: None = uncalibrated.
        """
        camera = camera or CameraModel.guessed(width, height, self._focal_share)
        camera = camera.resized(width, height)
        q, p = undistorted(earlier, camera), undistorted(current, camera)
        known = np.isfinite(q).all(axis=1) & np.isfinite(p).all(axis=1)
        q, p = q[known], p[known]
        last, self._last = self._last, None
        if len(q) < MIN_SAMPLES:
            return None
        turn = rotation_only(q, p)
        left = np.hypot(*_rotation_residual(turn, q, p).T)
        if not _shows_parallax(left, MIN_SIGMA_PX / camera.fx):
            return None
        motion = _only_motion(q, p, camera.fx, last)
        if motion is None or motion.inlier_share < MIN_INLIER_SHARE:
            return None
        sigma = max(MIN_SIGMA_PX / camera.fx, MAD_TO_SIGMA * float(np.median(line_distance(q, p, motion))))
        if not _shows_parallax(left, sigma):
            return None
        self._last = motion
        return _relative_pose_of(q, p, motion, sigma, camera)


def _shows_parallax(left: DoubleArray, sigma: float) -> bool:
    """left: (N,) residual of the rotation for each track; sigma: its noise, one deviation."""
    return float((left > PARALLAX_SIGMAS * sigma).mean()) >= MIN_PARALLAX_SHARE


def _only_motion(
    q: DoubleArray, p: DoubleArray, focal_px: float, last: PoseEstimate | None,
) -> PoseEstimate | None:
    """The motion that fits best; None where one in another direction fits as well.

    Under slow travel nearly all tracks are RANSAC inliers of many motions, so those that the dominant plane allows
    are compared too.
    """
    found = estimate_pose(q, p, np.ones(len(q), bool), focal_px, last)
    if found is None:
        return None
    motions = [found, *(refine_pose(q, p, start, focal_px) for start in _through_a_plane(q, p, focal_px))]
    costs = [focal_px * float(np.minimum(line_distance(q, p, motion), CLEARLY_OFF_PX / focal_px).mean())
             for motion in motions]
    best = motions[int(np.argmin(costs))]
    as_good = RIVAL_SHARE * min(costs) + RIVAL_PX
    if any(cost < as_good and abs(motion.direction @ best.direction) < SAME_DIRECTION
           for motion, cost in zip(motions, costs, strict=True)):
        return None
    return best


def _through_a_plane(q: DoubleArray, p: DoubleArray, focal_px: float) -> list[PoseEstimate]:
    """The motions, two at most, that agree with the homography of the dominant plane (Malis and Vargas 2007)."""
    homography, _ = cv2.findHomography(q, p, cv2.RANSAC, INLIER_PX / focal_px)
    if homography is None:
        return []
    _, rotations, translations, normals = cv2.decomposeHomographyMat(homography, np.eye(3))
    return [PoseEstimate(rotation, translation.ravel() / np.linalg.norm(translation), 0.0)
            for rotation, translation, normal in zip(rotations, translations, normals, strict=True)
            if normal[2] > 0.0 and np.linalg.norm(translation) > 0.0]


def line_distance(q: DoubleArray, p: DoubleArray, motion: PoseEstimate) -> DoubleArray:
    """(N,) distance of each track's end ``p`` from the epipolar line of its start ``q``, normalised."""
    lines = epipolar_lines(q, motion)
    away, along = p - lines.far, lines.towards
    across: DoubleArray = np.abs(away[:, 0] * along[:, 1] - away[:, 1] * along[:, 0])
    return across / np.maximum(np.hypot(*along.T), 1e-9)


def rotation_only(q: DoubleArray, p: DoubleArray) -> DoubleArray:
    """(3, 3) the rotation that takes ``q`` to ``p``, (N, 2) normalised, as if everything were infinitely far.

    Wahba's problem by singular values (Kabsch 1976), re-weighted with Tukey's biweight.
    """
    rays, seen = _unit_rays(q), _unit_rays(p)

    def errors(rotation: DoubleArray) -> DoubleArray:
        return np.asarray(np.hypot(*_rotation_residual(rotation, q, p).T), np.float64)

    def weights(error: DoubleArray) -> DoubleArray:
        return tukey_weights(error, max(float(np.median(error)), 1e-9))

    def solve(_: DoubleArray, error: DoubleArray, weights: DoubleArray) -> DoubleArray:
        return _procrustes(rays, seen, weights)

    return reweighted(_procrustes(rays, seen, np.ones(len(q))), errors, weights, solve, ROUNDS)


def _procrustes(rays: DoubleArray, seen: DoubleArray, weights: DoubleArray) -> DoubleArray:
    """(3, 3) the rotation that takes ``rays`` closest to ``seen``, (N, 3) each, by weighted least squares."""
    u, _, vt = np.linalg.svd((seen * weights[:, None]).T @ rays)
    rotation: DoubleArray = u @ np.diag([1.0, 1.0, np.linalg.det(u @ vt)]) @ vt
    return rotation


def _unit_rays(points: DoubleArray) -> DoubleArray:
    rays = np.column_stack([points, np.ones(len(points))])
    unit: DoubleArray = rays / np.linalg.norm(rays, axis=1)[:, None]
    return unit


def _rotation_residual(rotation: DoubleArray, q: DoubleArray, p: DoubleArray) -> DoubleArray:
    """(N, 2) residual of a rotation, normalised."""
    turned = q @ rotation[:, :2].T + rotation[:, 2]
    left: DoubleArray = p - turned[:, :2] / turned[:, 2:]
    return left


def _relative_pose_of(
    q: DoubleArray, p: DoubleArray, motion: PoseEstimate, sigma: float, camera: CameraModel,
) -> RelativePose:
    lines = epipolar_lines(q, motion)
    reach_px = np.hypot(*lines.towards.T) * camera.fx
    ground = ground_below(q, lines.inverse_depth(lines.position(p)), reach_px, p[:, 1] > 0.0, sigma * camera.fx)
    t = motion.direction
    with np.errstate(divide='ignore', invalid='ignore'):
        epipole = distorted((t[:2] / t[2])[None], camera)[0]
    plane = None if ground is None else plane_seen_now(ground.coefficients, motion)
    return RelativePose(motion.rotation, t, epipole, plane)


def plane_seen_now(plane: DoubleArray, motion: PoseEstimate) -> DoubleArray:
    """(3,) the plane g . X = 1 of the earlier camera in coordinates of the current one, X_now = R X + t."""
    turned = motion.rotation @ plane
    now: DoubleArray = turned / (1.0 + turned @ motion.direction)
    return now
