"""Robust fit of a family of motions to points before and after."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from motion_detect_ros.core.geometry.motion_models import ModelFamily, displacement, jacobian, matrix_theta, normalised
from motion_detect_ros.core.geometry.order_statistics import median, select
from motion_detect_ros.core.geometry.robust import MAD_TO_SIGMA, TUKEY_C
from motion_detect_ros.core.kernels import kernel
from motion_detect_ros.core.types import BoolArray, DoubleArray, FloatArray, MotionModel

#: Localisation noise no tracker gets under, pixels.
MIN_SIGMA_PX = 0.02
#: Re-weighting rounds; the fit is stable after four to six.
ITERATIONS = 6
#: Eigenvalue of the normal equations, relative to the largest, from which the points do not determine the motion.
SINGULAR = 1e-10


@dataclass(frozen=True)
class MotionFit:
    """``theta``: (8,), ``covariance``: (8, 8), pixels, see ``motion_models``; ``inliers``: (N,) bool.

    ``residual_px``: median distance of the inliers to the model.
    """

    theta: DoubleArray
    covariance: DoubleArray
    inliers: BoolArray
    residual_px: float
    model: MotionModel


def fit_motion(
    family: ModelFamily, points: FloatArray, moved: FloatArray, threshold_px: float, centre: DoubleArray,
) -> MotionFit | None:
    """RANSAC (Fischler and Bolles 1981), then ``refine_motion``; None where the points do not determine the motion.

    points, moved: (N, 2) float32, previous and current positions, pixels; threshold_px: of RANSAC; centre: (2,).
    """
    start = family.start(points, moved, threshold_px)
    if start is None or not np.isfinite(start).all():
        return None
    theta = matrix_theta(start, centre)
    return refine_motion(family, points, moved, theta, centre) if np.isfinite(theta).all() else None


def refine_motion(
    family: ModelFamily, points: FloatArray, moved: FloatArray, theta: DoubleArray, centre: DoubleArray,
) -> MotionFit | None:
    """Iteratively re-weighted Gauss-Newton (Tukey's biweight) from a start close to the solution.

    points, moved: (N, 2) float32, previous and current positions, pixels; theta: (8,) the start, pixels; centre: (2,)
    of the image, pixels. The covariance is that of weighted least squares with the variance measured on the inliers.
    None where the points do not determine the motion (singular normal equations).
    Source: Holland and Welsch 1977, with the weights of Beaton and Tukey 1974.
    """
    x, target = normalised(points, centre), (moved - points).T.astype(np.float64)
    fixed = _steps(family, theta, x, centre) if family.polynomial else None
    errors, weights, scratch = np.empty_like(target), np.empty(len(x)), np.empty(2 * len(x))
    free = np.asarray(np.linalg.lstsq(family.basis, theta, rcond=None)[0], np.float64)
    for _ in range(ITERATIONS):
        steps = _linearised(family, free, x, centre, target, fixed, errors)
        _weigh(errors, MIN_SIGMA_PX, scratch, weights)
        weighted = _weighted(steps, weights)
        free = free + np.linalg.lstsq(weighted @ steps.T, weighted @ errors.ravel(), rcond=None)[0]
    steps = _linearised(family, free, x, centre, target, fixed, errors)
    _weigh(errors, MIN_SIGMA_PX, scratch, weights)
    return _summary(family, free, errors, weights, steps)


def _linearised(
    family: ModelFamily, free: DoubleArray, x: DoubleArray, centre: DoubleArray, target: DoubleArray,
    fixed: DoubleArray | None, errors: DoubleArray,
) -> DoubleArray:
    """The steps, (k, 2 N), at the parameters ``free``, (k,); ``errors``, (2, N), become theirs.

    target: (2, N) measured displacements; fixed: the steps where they do not depend on the parameters.
    """
    if fixed is not None:
        np.subtract(target, (free @ fixed).reshape(2, -1), out=errors)
        return fixed
    theta = family.basis @ free
    np.subtract(target, displacement(family, theta, x, centre).T, out=errors)
    return _steps(family, theta, x, centre)


def _steps(family: ModelFamily, theta: DoubleArray, x: DoubleArray, centre: DoubleArray) -> DoubleArray:
    """(k, 2 N): derivative by the free parameters of all dx, then of all dy."""
    by_theta = jacobian(family, theta, x, centre).transpose(2, 1, 0).reshape(family.basis.shape[0], -1)
    steps: DoubleArray = family.basis.T @ by_theta
    return steps


def _weighted(steps: DoubleArray, weights: DoubleArray) -> DoubleArray:
    weighted: DoubleArray = (steps.reshape(len(steps), 2, -1) * weights).reshape(len(steps), -1)
    return weighted


@kernel()
def _weigh(errors, least_sigma, scratch, weights):  # type: ignore[no-untyped-def]
    """``weights``: (N,) Tukey's, of errors (2, N), by the median deviation of both components from their medians.

    scratch: (2 N,). Of an even number the upper one in the middle is the median.
    """
    count = len(weights)
    middle_x, middle_y = 0.0, 0.0
    for axis in range(2):
        for n in range(count):
            scratch[n] = errors[axis, n]
        middle = select(scratch[:count], count // 2)
        middle_x, middle_y = middle_y, middle
    for n in range(count):
        scratch[n], scratch[count + n] = abs(errors[0, n] - middle_x), abs(errors[1, n] - middle_y)
    bound = TUKEY_C * max(MAD_TO_SIGMA * select(scratch, count), least_sigma)
    for n in range(count):
        share = max(1.0 - (errors[0, n] * errors[0, n] + errors[1, n] * errors[1, n]) / (bound * bound), 0.0)
        weights[n] = share * share


def _summary(
    family: ModelFamily, free: DoubleArray, errors: DoubleArray, weights: DoubleArray, steps: DoubleArray,
) -> MotionFit | None:
    normal, inliers = _weighted(steps, weights) @ steps.T, weights > 0.0
    eigenvalues = np.linalg.eigvalsh(normal)
    if not np.isfinite(free).all() or eigenvalues[0] <= SINGULAR * eigenvalues[-1]:
        return None
    freedom = max(2.0 * weights.sum() - family.basis.shape[1], 2.0)
    variance = max(float((weights * errors ** 2).sum() / freedom), MIN_SIGMA_PX ** 2)
    covariance = variance * family.basis @ np.linalg.inv(normal) @ family.basis.T
    residual = float(median(np.hypot(*errors)[inliers]))
    return MotionFit(family.basis @ free, covariance, inliers, residual, family.kind)
