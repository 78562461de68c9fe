"""The ground plane: below the horizon nothing static is farther away than the ground."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from motion_detect_ros.core.geometry.normal_equations import tukey_sums
from motion_detect_ros.core.geometry.robust import TUKEY_C
from motion_detect_ros.core.kernels import kernel
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

    @property
    def limit(self) -> DoubleArray:
        """(3,) a plane like ``coefficients`` that real ground does not fall below; nor does it below 0, infinity."""
        g: DoubleArray = self.coefficients * (1.0 - DEPTH_SLACK)
        g[2] -= TILT_SLACK_RAD * math.hypot(*self.coefficients[:2])
        return g


def fit_ground(points: DoubleArray, inverse_depth: DoubleArray, sigma: DoubleArray) -> GroundPlane | None:
    """RANSAC (Fischler and Bolles 1981), then Tukey-weighted least squares; None where no plane below is dominant.

    points: (N, 2) normalised, of the lower half of the image; inverse_depth, sigma: (N,), sigma one deviation.
    """
    if len(points) < MIN_POINTS:
        return None
    rows, target = np.column_stack([points, np.ones(len(points))]) / sigma[:, None], inverse_depth / sigma
    plane, normal, right = _consensus(rows, target), np.empty((3, 3)), np.empty(3)
    for _ in range(ROUNDS):
        tukey_sums(rows, rows @ plane - target, TUKEY_C, normal, right)
        plane = plane - np.linalg.lstsq(normal, right, rcond=None)[0]
    share = _agreeing(rows, target, plane) / len(points)
    return GroundPlane(plane) if share >= MIN_SHARE and plane[1] > 0.0 else None


def ground_below(
    earlier: DoubleArray, inverse_depth: DoubleArray, reach_px: DoubleArray, below: BoolArray,
    noise_px: float = DEPTH_NOISE_PX,
) -> GroundPlane | None:
    """The ground under the points marked ``below``.

    earlier: (..., 2) normalised; inverse_depth: (...,); reach_px: (...,) pixels that a point moves for one unit of s;
    noise_px: of the points' motion, one deviation.
    """
    use = np.flatnonzero(below & (inverse_depth > 0.0))
    use = use[::max(1, -(-use.size // MAX_POINTS))]
    inverse = inverse_depth.ravel()[use]
    sigma = noise_px / np.maximum(reach_px.ravel()[use], 1e-3) + DEPTH_NOISE_SHARE * inverse + 1e-4
    return fit_ground(earlier.reshape(-1, 2)[use], inverse, sigma)


def _consensus(rows: DoubleArray, target: DoubleArray) -> DoubleArray:
    """The plane through three points that the most points agree with.

    rows: (N, 3) points (x, y, 1), target: (N,) their inverse depths, both over the deviation of the latter.
    """
    random = np.random.default_rng(0)
    picks = random.integers(0, len(target), (TRIALS, 3))
    triples = rows[picks] + 1e-9 * np.eye(3)
    planes = np.linalg.solve(triples, target[picks][..., None])[..., 0]
    best: DoubleArray = planes[int(np.argmax([_agreeing(rows, target, plane) for plane in planes]))]
    return best


@kernel(error_model='numpy')
def _agreeing(rows, target, plane):  # type: ignore[no-untyped-def]
    """Number of points that agree with a plane, (3,); ``rows``, ``target`` as of ``_consensus``."""
    count = 0
    for n in range(len(target)):
        error = rows[n, 0] * plane[0] + rows[n, 1] * plane[1] + rows[n, 2] * plane[2] - target[n]
        count += abs(error) < AGREE_SIGMAS
    return count
