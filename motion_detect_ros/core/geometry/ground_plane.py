"""The ground plane: below the horizon nothing static is farther away than the ground."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from motion_detect_ros.core.geometry.robust import reweighted, tukey_weights
from motion_detect_ros.core.types import BoolArray, DoubleArray

#: Points used at most and needed at least, and random planes tried.
MAX_POINTS, MIN_POINTS, TRIALS = 1200, 60, 60
#: Distance to the plane up to which a point agrees, deviations; share of points that must agree.
AGREE_SIGMAS, MIN_SHARE = 2.0, 0.3
#: Re-weighting rounds.
ROUNDS = 6
#: How far real ground may be behind the plane: share of its inverse depth, and tilt of the horizon, radians.
DEPTH_SLACK, TILT_SLACK_RAD = 0.15, 0.01
#: Noise of the inverse depth: of the flow, pixels, and share of itself.
DEPTH_NOISE_PX, DEPTH_NOISE_SHARE = 0.3, 0.05


@dataclass(frozen=True)
class GroundPlane:
    """``coefficients``: (3,) g with inverse depth = g . (x, y, 1) in normalised coordinates of the earlier frame."""

    coefficients: DoubleArray

    def least_inverse_depth(self, points: DoubleArray) -> DoubleArray:
        """(...,) inverse depth that a static point seen at ``points`` (..., 2) cannot fall below; 0 = infinity."""
        g = self.coefficients
        plane = points @ g[:2] + g[2]
        least: DoubleArray = np.maximum(0.0, plane * (1.0 - DEPTH_SLACK) - TILT_SLACK_RAD * np.hypot(g[0], g[1]))
        return least


def fit_ground(points: DoubleArray, inverse_depth: DoubleArray, sigma: DoubleArray) -> GroundPlane | None:
    """RANSAC (Fischler and Bolles 1981), then Tukey-weighted least squares; None where no plane below is dominant.

    points: (N, 2) normalised, of the lower half of the image; inverse_depth, sigma: (N,), sigma one deviation.
    """
    step = max(1, -(-len(points) // MAX_POINTS))
    design = np.column_stack([points[::step], np.ones(len(points[::step]))])
    target, sigma = inverse_depth[::step], sigma[::step]
    if len(target) < MIN_POINTS:
        return None

    def solve(_: DoubleArray, error: DoubleArray, weights: DoubleArray) -> DoubleArray:
        weighted = design * (weights / sigma ** 2)[:, None]
        return np.asarray(np.linalg.lstsq(weighted.T @ design, weighted.T @ target, rcond=None)[0], np.float64)

    plane = reweighted(_consensus(design, target, sigma), lambda plane: (design @ plane - target) / sigma,
                       tukey_weights, solve, ROUNDS)
    share = float((np.abs(design @ plane - target) < AGREE_SIGMAS * sigma).mean())
    return GroundPlane(plane) if share >= MIN_SHARE and plane[1] > 0.0 else None


def ground_below(
    earlier: DoubleArray, inverse_depth: DoubleArray, reach_px: DoubleArray, below: BoolArray,
    noise_px: float = DEPTH_NOISE_PX,
) -> GroundPlane | None:
    """The ground under the points marked ``below``.

    earlier: (..., 2) normalised; inverse_depth: (...,); reach_px: (...,) pixels that a point moves for one unit of s;
    noise_px: of the points' motion, one deviation.
    """
    use = below & (inverse_depth > 0.0)
    inverse = inverse_depth[use]
    sigma = noise_px / np.maximum(reach_px[use], 1e-3) + DEPTH_NOISE_SHARE * inverse + 1e-4
    return fit_ground(earlier[use], inverse, sigma)


def _consensus(design: DoubleArray, target: DoubleArray, sigma: DoubleArray) -> DoubleArray:
    """The plane through three points that the most points agree with."""
    random = np.random.default_rng(0)
    picks = random.integers(0, len(target), (TRIALS, 3))
    triples = design[picks] + 1e-9 * np.eye(3)
    planes = np.linalg.solve(triples, target[picks][..., None])[..., 0]
    agree = (np.abs(design @ planes.T - target[:, None]) < AGREE_SIGMAS * sigma[:, None]).sum(axis=0)
    best: DoubleArray = planes[int(np.argmax(agree))]
    return best
