"""The camera's motion in space, from the tracks of one pair of frames: rotation, direction, epipole and ground.

A turn alone moves points whatever their depth; the direction of travel shows only in what a turn leaves over, the
parallax. Where that is not clearly more than the tracks' noise there is no answer.

Plane: seen from a drone the ground often is the whole picture. A narrow view of it under sideways travel looks like a
turn. With more perspective two motions explain every track equally well, the plane's normal and the direction of travel
swapped (Longuet-Higgins 1986); they are weighed against each other on all tracks, and only where things off the plane
(a fifth of the tracks in the tests) decide between them there is an answer. So flat ground alone gives none.
"""

from __future__ import annotations

import cv2
import numpy as np

from motion_detect_ros.core.geometry.epipolar import (
    INLIER_PX,
    MIN_SAMPLES,
    PoseEstimate,
    epipolar_lines,
    estimate_pose,
    normalised,
    refine_pose,
)
from motion_detect_ros.core.geometry.ground_plane import ground_below
from motion_detect_ros.core.geometry.robust import MAD_TO_SIGMA, reweighted, tukey_weights
from motion_detect_ros.core.types import CameraModel, DoubleArray, FloatArray, RelativePose

#: Share of the tracks that must lie on their epipolar lines: else there is no common motion.
MIN_INLIER_SHARE = 0.5
#: Length from which what a turn leaves of a track is parallax, deviations of its noise; smallest deviation, pixels.
PARALLAX_SIGMAS, MIN_SIGMA_PX = 4.0, 0.1
#: Share of the tracks that must show parallax; one or two movers before a camera that only turns stay below it.
MIN_PARALLAX_SHARE = 0.3
#: Distance from the epipolar line from which a track is off by more makes no motion worse, pixels.
CLEARLY_OFF_PX = 0.5
#: Up to this multiple of the best mean distance, and this much more in pixels, a motion fits as well as the best ...
RIVAL_SHARE, RIVAL_PX = 1.1, 0.005
#: ... and goes elsewhere where the cosine between the directions is under this (10 degrees).
SAME_DIRECTION = 0.985
#: Re-weighting rounds of the rotation alone.
ROUNDS = 7


class RelativePoseEstimator:
    """Remembers the motion of the last frame: it is where the next search starts."""

    def __init__(self, focal_share: float) -> None:
        """focal_share: focal length where no calibration is known, share of the image width."""
        self._focal_share = focal_share
        self._last: PoseEstimate | None = None

    def reset(self) -> None:
        """Forget the last frame's motion."""
        self._last = None

    def estimate(
        self, earlier: FloatArray, current: FloatArray, width: int, height: int, camera: CameraModel | None,
    ) -> RelativePose | None:
        """None where the tracks do not determine the motion: too few, no common motion, too little parallax.

        earlier, current: (N, 2) full-resolution pixels of a ``width`` x ``height`` image; camera: None = uncalibrated.
        """
        camera = camera or CameraModel.guessed(width, height, self._focal_share)
        camera = camera.resized(width, height)
        q, p = normalised(earlier, camera), normalised(current, camera)
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
    """left: (N,) what the turn leaves of each track; sigma: its noise, one deviation."""
    return float((left > PARALLAX_SIGMAS * sigma).mean()) >= MIN_PARALLAX_SHARE


def _only_motion(
    q: DoubleArray, p: DoubleArray, focal_px: float, last: PoseEstimate | None,
) -> PoseEstimate | None:
    """The motion that fits best; None where one that goes elsewhere fits as well.

    Where the camera travels slowly, RANSAC's inliers are nearly all tracks under many a motion: those that the
    dominant plane allows are tried too.
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
    """The motions, two at most, under which the dominant plane of the tracks moves as it does (Malis, Vargas 2007)."""
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
    """(N, 2) what a rotation leaves of the tracks, normalised."""
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
        epipole = t[:2] / t[2] * [camera.fx, camera.fy] + [camera.cx, camera.cy]
    plane = None if ground is None else plane_seen_now(ground.coefficients, motion)
    return RelativePose(motion.rotation, t, epipole, plane)


def plane_seen_now(plane: DoubleArray, motion: PoseEstimate) -> DoubleArray:
    """(3,) the plane g . X = 1 of the earlier camera in coordinates of the current one, X_now = R X + t."""
    turned = motion.rotation @ plane
    now: DoubleArray = turned / (1.0 + turned @ motion.direction)
    return now
