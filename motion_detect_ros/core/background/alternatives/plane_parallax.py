"""Plane plus parallax: a three-dimensional background without calibration.

The homography of the dominant plane explains that plane exactly; what it leaves of any other static point lies on the
line through the epipole (Irani and Anandan 1998, equation 5; Sawhney 1994). Where the plane is the ground, everything
else is on one side of it, and the parallax of static points has one sign.
"""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np

from motion_detect_ros.core.background.planar import Background, background_of_static_points
from motion_detect_ros.core.config import BackgroundConfig
from motion_detect_ros.core.geometry.warp import apply, grid_points
from motion_detect_ros.core.types import DoubleArray, FloatArray

#: Correspondences used at most and needed at least; random pairs of lines tried.
MAX_SAMPLES, MIN_SAMPLES, TRIALS = 1500, 60, 200
#: Distance to the plane's motion, and to the line through the epipole, up to which a point agrees, pixels.
PLANE_PX, LINE_PX = 1.0, 1.0
#: Parallax from which a point says where the epipole is, pixels.
MIN_PARALLAX_PX = 2.0
#: Share of the parallax of one sign from which the other sign is taken for motion.
ONE_SIDED_SHARE = 0.9
ROUNDS = 6


@dataclass(frozen=True)
class PlaneParallax:
    """``homography``: (3, 3) earlier pixel -> current pixel; ``epipole``: (3,) homogeneous, current frame's pixels.

    ``sign``: +1 or -1 where static points move away from or towards the epipole only, 0 where both occur.
    """

    homography: DoubleArray
    epipole: DoubleArray
    sign: int

    def nearest(self, earlier: DoubleArray, now: DoubleArray) -> DoubleArray:
        """(..., 2) the place closest to ``now`` where a static point seen at ``earlier`` may be, pixels."""
        on_plane, along, gamma = _along(self, earlier, now)
        if self.sign:
            gamma = np.where(gamma * self.sign > 0.0, gamma, 0.0)
        place: DoubleArray = on_plane + gamma[..., None] * along
        return place


def fit_parallax_background(
    flow: FloatArray, residual: FloatArray, width: int, height: int, config: BackgroundConfig,
) -> Background | None:
    """The background as plane plus parallax, relative to the ego-motion as ``residual`` is; None where undetermined.

    flow: (gh, gw, 2) total displacement, full-resolution pixels of a ``width`` x ``height`` image; NaN = invalid.
    """
    now = grid_points(flow.shape[0], flow.shape[1], width, height).astype(np.float64)
    earlier = now - flow
    known = np.isfinite(residual[..., 0])
    model = fit_plane_parallax(earlier[known], now[known], width)
    if model is None:
        return None
    own = now - model.nearest(earlier, now)
    return background_of_static_points(residual, own, flow, config)


def fit_plane_parallax(earlier: DoubleArray, now: DoubleArray, width: int) -> PlaneParallax | None:
    """Dominant plane by RANSAC, epipole as the point that most parallax lines meet in. earlier, now: (N, 2) pixels."""
    step = max(1, len(earlier) // MAX_SAMPLES)
    q, p = earlier[::step], now[::step]
    if len(q) < MIN_SAMPLES:
        return None
    homography, _ = cv2.findHomography(q, p, cv2.RANSAC, PLANE_PX)
    if homography is None:
        return None
    start = PlaneParallax(homography, np.array([0.0, 0.0, 1.0]), 0)
    on_plane = _on_plane(homography, q)
    parallax = np.hypot(*(p - on_plane).T)
    tells = parallax > MIN_PARALLAX_PX
    if np.count_nonzero(tells) < MIN_SAMPLES:
        return start
    epipole = _meeting_point(on_plane[tells] / width, p[tells] / width, LINE_PX / width)
    epipole = epipole * [width, width, 1.0]
    model = PlaneParallax(homography, epipole / np.linalg.norm(epipole), 0)
    _, _, gamma = _along(model, q[tells], p[tells])
    away = float((gamma > 0.0).mean())
    sign = 1 if away >= ONE_SIDED_SHARE else -1 if away <= 1.0 - ONE_SIDED_SHARE else 0
    return PlaneParallax(homography, model.epipole, sign)


def _on_plane(homography: DoubleArray, points: DoubleArray) -> DoubleArray:
    return apply(homography, points.astype(np.float32)).astype(np.float64)


def _along(
    model: PlaneParallax, earlier: DoubleArray, now: DoubleArray,
) -> tuple[DoubleArray, DoubleArray, DoubleArray]:
    """Where the plane's motion carries a point, unit direction away from the epipole there, parallax along it."""
    on_plane = _on_plane(model.homography, earlier)
    away = model.epipole[2] * on_plane - model.epipole[:2]
    away = away / np.maximum(np.hypot(away[..., 0], away[..., 1]), 1e-12)[..., None]
    return on_plane, away, ((now - on_plane) * away).sum(axis=-1)


def _meeting_point(start: DoubleArray, end: DoubleArray, near: float) -> DoubleArray:
    """(3,) homogeneous point that most of the lines from ``start`` to ``end`` (N, 2) pass within ``near``."""
    ones = np.ones((len(start), 1))
    lines = np.cross(np.hstack([start, ones]), np.hstack([end, ones]))
    lines /= np.hypot(lines[:, 0], lines[:, 1])[:, None]
    picks = np.random.default_rng(0).integers(0, len(lines), (TRIALS, 2))
    points = np.cross(lines[picks[:, 0]], lines[picks[:, 1]])
    points /= np.maximum(np.linalg.norm(points, axis=1), 1e-12)[:, None]
    votes = [(_miss(start, end, point) < near).sum() for point in points]
    best: DoubleArray = points[int(np.argmax(votes))]
    for _ in range(ROUNDS):
        miss = _miss(start, end, best)
        weight = np.clip(1.0 - (miss / (3.0 * near)) ** 2, 0.0, None)
        scaled = lines * (weight * np.hypot(*(end - start).T))[:, None]
        best = np.linalg.svd(scaled, full_matrices=False)[2][-1]
    return best


def _miss(start: DoubleArray, end: DoubleArray, epipole: DoubleArray) -> DoubleArray:
    """(N,) distance of ``end`` to the line from ``start`` through the epipole."""
    along = epipole[:2] - epipole[2] * start
    along = along / np.maximum(np.hypot(along[:, 0], along[:, 1]), 1e-12)[:, None]
    away = end - start
    distance: DoubleArray = np.abs(away[:, 0] * along[:, 1] - away[:, 1] * along[:, 0])
    return distance
