"""Motion of the background beyond the chained ego-motion, over one baseline: none, or a linearised homography.

    dx = c0 + c1 x + c2 y + c6 x^2 + c7 x y,   dy = c3 + c4 x + c5 y + c6 x y + c7 y^2

with x, y from the image centre in units of half its width (Bergen et al. 1992, equation 8). The chain is kept where the
plane is not clearly better on points that it was not fitted to.
"""

from __future__ import annotations

import numpy as np

from motion_detect_ros.core.geometry.robust import rayleigh_sigma, reweighted, tukey_weights
from motion_detect_ros.core.geometry.vectors import magnitude
from motion_detect_ros.core.types import BoolArray, DoubleArray, FloatArray

#: Points used for a fit; rounds of re-weighting; least deviation, pixels; weight of the regularisation.
MAX_POINTS, ROUNDS, LEAST_SIGMA_PX, RIDGE = 1000, 5, 0.05, 1e-9
#: Two-fold cross-validation: squares of a checkerboard, share of the image width (96 of 960 pixels); the median error
#: on unseen squares must be under this share of the chain's.
SQUARE_SHARE, BETTER_SHARE = 0.1, 0.85
#: Fewest points of one colour of the checkerboard.
MIN_POINTS = 30


def plane_is_better(points: FloatArray, residual: DoubleArray, width: int, height: int) -> bool:
    """Whether a plane predicts ``residual`` at ``points``, (N, 2) pixels, better than the chain, which says 0."""
    chosen = slice(None, None, max(1, len(points) // MAX_POINTS))
    points, residual = points[chosen], residual[chosen]
    black: BoolArray = (points // (SQUARE_SHARE * width)).astype(np.intp).sum(axis=1) % 2 == 0
    if min(black.sum(), (~black).sum()) < MIN_POINTS:
        return False
    error = residual.copy()
    for unseen in (black, ~black):
        error[unseen] -= plane_motion(points[~unseen], residual[~unseen], points[unseen], width, height)
    return bool(_median_length(error) < BETTER_SHARE * _median_length(residual))


def plane_motion(
    points: FloatArray, residual: DoubleArray, places: FloatArray, width: int, height: int,
) -> DoubleArray:
    """(n, 2) motion at ``places`` of the plane that the most of ``residual`` (N, 2) at ``points`` agree with, pixels.

    Tukey-weighted least squares (IRLS).
    """
    chosen = slice(None, None, max(1, len(points) // MAX_POINTS))
    basis, wanted = _basis(points[chosen], width, height), residual[chosen]

    def errors(coefficients: DoubleArray) -> DoubleArray:
        return wanted - basis @ coefficients

    def weights(error: DoubleArray) -> DoubleArray:
        length = magnitude(error)
        return tukey_weights(length, max(LEAST_SIGMA_PX, rayleigh_sigma(length)))

    def solve(_: DoubleArray, __: DoubleArray, weight: DoubleArray) -> DoubleArray:
        return _least_squares(basis, wanted, weight)

    start = _least_squares(basis, wanted, np.ones(len(wanted)))
    motion: DoubleArray = _basis(places, width, height) @ reweighted(start, errors, weights, solve, ROUNDS)
    return motion


def _basis(points: FloatArray, width: int, height: int) -> DoubleArray:
    """(N, 2, 8) derivative of (dx, dy) by the coefficients."""
    x = (points[:, 0] - width / 2.0) / (width / 2.0)
    y = (points[:, 1] - height / 2.0) / (width / 2.0)
    basis = np.zeros((len(points), 2, 8))
    basis[:, 0, 0] = basis[:, 1, 3] = 1.0
    basis[:, 0, 1] = basis[:, 1, 4] = x
    basis[:, 0, 2] = basis[:, 1, 5] = y
    basis[:, 0, 6], basis[:, 0, 7], basis[:, 1, 6], basis[:, 1, 7] = x * x, x * y, x * y, y * y
    return basis


def _least_squares(basis: DoubleArray, wanted: DoubleArray, weight: DoubleArray) -> DoubleArray:
    flat, weights = basis.reshape(-1, 8), np.repeat(weight, 2)
    weighted = flat * weights[:, None]
    return np.asarray(np.linalg.solve(weighted.T @ flat + RIDGE * np.eye(8), weighted.T @ wanted.ravel()), np.float64)


def _median_length(vectors: DoubleArray) -> float:
    return float(np.median(magnitude(vectors)))
