"""Motion of the background beyond the chained ego-motion, over one baseline: none, or a linearised homography.

    dx = c0 + c1 x + c2 y + c6 x^2 + c7 x y,   dy = c3 + c4 x + c5 y + c6 x y + c7 y^2

with x, y from the image centre in units of half its width (Bergen et al. 1992, equation 8). The chain is kept where the
plane is not clearly better on points that it was not fitted to.
"""

from __future__ import annotations

import math

import numpy as np
from scipy.linalg import lapack

from motion_detect_ros.core.geometry.order_statistics import median
from motion_detect_ros.core.geometry.robust import RAYLEIGH_MEDIAN, TUKEY_C
from motion_detect_ros.core.geometry.vectors import magnitude
from motion_detect_ros.core.kernels import kernel
from motion_detect_ros.core.types import BoolArray, DoubleArray, FloatArray

#: Points used for a fit; rounds of re-weighting; least deviation, pixels; weight of the regularisation.
MAX_POINTS, ROUNDS, LEAST_SIGMA_PX, RIDGE = 1000, 5, 0.05, 1e-9
#: Two-fold cross-validation: squares of a checkerboard, share of the image width (96 of 960 pixels); the median error
#: on unseen squares must be under this share of the chain's.
SQUARE_SHARE, BETTER_SHARE = 0.1, 0.85
#: Fewest points of one colour of the checkerboard.
MIN_POINTS = 30
#: Where each element of the normal equations is among the sums of ``_weighted_sums``: sums over 1, x, y, xx, xy, yy,
#: xxx, xxy, xyy, yyy, then those of c6 c6, c6 c7 and c7 c7, then 0; and from where on the eight right-hand sides are.
NORMAL = np.array([
    [0, 1, 2, 13, 13, 13, 3, 4],
    [1, 3, 4, 13, 13, 13, 6, 7],
    [2, 4, 5, 13, 13, 13, 7, 8],
    [13, 13, 13, 0, 1, 2, 4, 5],
    [13, 13, 13, 1, 3, 4, 7, 8],
    [13, 13, 13, 2, 4, 5, 8, 9],
    [3, 6, 7, 4, 7, 8, 10, 11],
    [4, 7, 8, 5, 8, 9, 11, 12]])
SUMS, RIGHT = 22, 14
_RIDGE = RIDGE * np.eye(8)


def plane_is_better(points: FloatArray, residual: DoubleArray, width: int, height: int) -> bool:
    """Whether a plane predicts ``residual`` at ``points``, (N, 2) pixels, better than the chain, which says 0."""
    chosen = slice(None, None, max(1, len(points) // MAX_POINTS))
    points, residual = points[chosen], residual[chosen]
    column, row = (points // (SQUARE_SHARE * width)).astype(np.intp).T
    black: BoolArray = (column + row) % 2 == 0
    if min(black.sum(), (~black).sum()) < MIN_POINTS:
        return False
    error = residual.copy()
    for unseen in (black, ~black):
        error[unseen] -= plane_motion(points[~unseen], residual[~unseen], points[unseen], width, height)
    return bool(median(magnitude(error)) < BETTER_SHARE * median(magnitude(residual)))


def plane_motion(
    points: FloatArray, residual: DoubleArray, places: FloatArray, width: int, height: int,
) -> DoubleArray:
    """(n, 2) motion at ``places`` of the plane that the most of ``residual`` (N, 2) at ``points`` agree with, pixels.

    Tukey-weighted least squares (IRLS).
    """
    chosen = slice(None, None, max(1, len(points) // MAX_POINTS))
    points, wanted = np.ascontiguousarray(points[chosen]), np.ascontiguousarray(residual[chosen])
    motion, lengths, sums = np.empty((len(points), 2)), np.empty((2, len(points))), np.empty(SUMS)
    coefficients = np.zeros(8)
    for least_px in (math.inf, *ROUNDS * (LEAST_SIGMA_PX,)):  # at first all weights are 1
        _motion_at(points, width, height, coefficients, motion)
        _weighted_sums(points, width, height, wanted, motion, least_px, lengths, sums)
        coefficients = lapack.dposv(sums[NORMAL] + _RIDGE, sums[RIGHT:])[1]
    motion = np.empty((len(places), 2))
    _motion_at(places, width, height, coefficients, motion)
    return motion


@kernel()
def _motion_at(points, width, height, coefficients, motion):  # type: ignore[no-untyped-def]
    """``motion``: (N, 2) of the plane with these coefficients (8,) at points (N, 2), pixels."""
    half_width, half_height = 0.5 * width, 0.5 * height
    c = coefficients
    for n in range(len(points)):
        x, y = (points[n, 0] - half_width) / half_width, (points[n, 1] - half_height) / half_width
        common = c[6] * x + c[7] * y
        motion[n, 0] = c[0] + c[1] * x + c[2] * y + common * x
        motion[n, 1] = c[3] + c[4] * x + c[5] * y + common * y


@kernel()
def _weighted_sums(points, width, height, wanted, motion, least_px, lengths, sums):  # type: ignore[no-untyped-def]
    """``sums``: (SUMS,) of the normal equations, with Tukey's weights of the errors of ``motion``.

    points, wanted, motion: (N, 2) pixels; least_px: least deviation; lengths: (2, N) scratch.
    """
    for n in range(len(points)):
        dx, dy = wanted[n, 0] - motion[n, 0], wanted[n, 1] - motion[n, 1]
        lengths[0, n] = lengths[1, n] = math.sqrt(dx * dx + dy * dy)
    cut = TUKEY_C * max(least_px, median(lengths[1]) / RAYLEIGH_MEDIAN)
    half_width, half_height = 0.5 * width, 0.5 * height
    sums[:] = 0.0
    for n in range(len(points)):
        share = lengths[0, n] / cut
        if share >= 1.0:
            continue
        w = (1.0 - share * share) ** 2
        x, y = (points[n, 0] - half_width) / half_width, (points[n, 1] - half_height) / half_width
        dx, dy, xx, xy, yy = wanted[n, 0], wanted[n, 1], x * x, x * y, y * y
        along = x * dx + y * dy
        terms = (1.0, x, y, xx, xy, yy, xx * x, xx * y, xy * y, yy * y, xx * (xx + yy), xy * (xx + yy), yy * (xx + yy),
                 0.0, dx, x * dx, y * dx, dy, x * dy, y * dy, x * along, y * along)
        for k in range(len(terms)):
            sums[k] += w * terms[k]
