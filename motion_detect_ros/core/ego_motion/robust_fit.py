"""Robust fit of a family of motions to points before and after."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from motion_detect_ros.core.geometry.motion_models import ModelFamily, displacement, jacobian, matrix_theta, normalised
from motion_detect_ros.core.geometry.robust import MAD_TO_SIGMA, reweighted, tukey_weights_of_squares
from motion_detect_ros.core.geometry.vectors import magnitude
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
    x, target = normalised(points, centre), (moved - points).astype(np.float64)
    fixed = _steps(family, theta, x, centre) if family.polynomial else None

    def steps_at(theta: DoubleArray) -> DoubleArray:
        return _steps(family, theta, x, centre) if fixed is None else fixed

    def errors(theta: DoubleArray) -> DoubleArray:
        return target - displacement(family, theta, x, centre)

    def solve(theta: DoubleArray, error: DoubleArray, weights: DoubleArray) -> DoubleArray:
        steps = steps_at(theta)
        weighted = _weighted(steps, weights)
        change = np.linalg.lstsq(weighted @ steps.T, weighted @ error.T.ravel(), rcond=None)[0]
        return np.asarray(theta + family.basis @ change, np.float64)

    start = family.basis @ np.linalg.lstsq(family.basis, theta, rcond=None)[0]
    theta = reweighted(start, errors, _weights, solve, ITERATIONS)
    error = errors(theta)
    return _summary(family, theta, error, _weights(error), steps_at(theta))


def _steps(family: ModelFamily, theta: DoubleArray, x: DoubleArray, centre: DoubleArray) -> DoubleArray:
    """(k, 2 N): derivative by the free parameters of all dx, then of all dy."""
    by_theta = jacobian(family, theta, x, centre).transpose(2, 1, 0).reshape(family.basis.shape[0], -1)
    steps: DoubleArray = family.basis.T @ by_theta
    return steps


def _weighted(steps: DoubleArray, weights: DoubleArray) -> DoubleArray:
    weighted: DoubleArray = (steps.reshape(len(steps), 2, -1) * weights).reshape(len(steps), -1)
    return weighted


def _weights(error: DoubleArray) -> DoubleArray:
    sigma = max(MAD_TO_SIGMA * float(_median(np.abs(error - _median(error)).ravel())), MIN_SIGMA_PX)
    x, y = error.T
    return tukey_weights_of_squares(x * x + y * y, sigma)


def _median(values: DoubleArray) -> DoubleArray:
    """Along the first axis; of the two in the middle, where there are two, the upper one."""
    middle = len(values) // 2
    median: DoubleArray = np.partition(values, middle, axis=0)[middle]
    return median


def _summary(
    family: ModelFamily, theta: DoubleArray, error: DoubleArray, weights: DoubleArray, steps: DoubleArray,
) -> MotionFit | None:
    normal, inliers = _weighted(steps, weights) @ steps.T, weights > 0.0
    eigenvalues = np.linalg.eigvalsh(normal)
    if not np.isfinite(theta).all() or eigenvalues[0] <= SINGULAR * eigenvalues[-1]:
        return None
    freedom = max(2.0 * weights.sum() - family.basis.shape[1], 2.0)
    variance = max(float((weights[:, None] * error ** 2).sum() / freedom), MIN_SIGMA_PX ** 2)
    covariance = variance * family.basis @ np.linalg.inv(normal) @ family.basis.T
    residual = float(np.median(magnitude(error)[inliers]))
    return MotionFit(theta, covariance, inliers, residual, family.kind)
