"""The six-parameter affine motion model and its robust fit.

dx = a0 + a1 x + a2 y,  dy = a3 + a4 x + a5 y   (Bergen et al. 1992, equation 7), with x, y the position of a
background point in the previous frame and dx, dy its displacement to the current one.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from motion_detect_ros.core.types import BoolArray, DoubleArray, FloatArray

#: Tukey's tuning constant for 95 % efficiency under Gaussian noise, in standard deviations.
TUKEY_C = 4.685
#: Gaussian consistency factor of the median absolute deviation.
MAD_TO_SIGMA = 1.4826
#: Localisation noise no tracker gets under, pixels.
MIN_SIGMA_PX = 0.02


@dataclass(frozen=True)
class AffineFit:
    """``params``: (6,) a0..a5; ``covariance``: (6, 6); ``inliers``: (N,) bool; ``residual_px``: median of inliers."""

    params: DoubleArray
    covariance: DoubleArray
    inliers: BoolArray
    residual_px: float


def affine_matrix(params: DoubleArray) -> DoubleArray:
    """(6,) a0..a5 -> (3, 3) matrix that maps previous pixel to current pixel."""
    a0, a1, a2, a3, a4, a5 = params
    return np.array([[1.0 + a1, a2, a0], [a4, 1.0 + a5, a3], [0.0, 0.0, 1.0]])


def affine_params(matrix: DoubleArray) -> DoubleArray:
    """(3, 3) -> (6,) a0..a5, the inverse of ``affine_matrix``; the last row is ignored."""
    m = matrix
    return np.array([m[0, 2], m[0, 0] - 1.0, m[0, 1], m[1, 2], m[1, 0], m[1, 1] - 1.0])


def refine_affine(points: FloatArray, moved: FloatArray, params: DoubleArray, iterations: int = 6) -> AffineFit:
    """Iteratively re-weighted least squares (Tukey's biweight) from a start close to the solution.

    points, moved: (N, 2), previous and current positions, pixels; params: (6,) start, e.g. of RANSAC.
    The covariance is that of weighted least squares with the variance measured on the inliers.
    """
    design = np.column_stack([np.ones(len(points)), points]).astype(np.float64)
    target = (moved - points).astype(np.float64)
    solution: DoubleArray = params.reshape(2, 3).T.astype(np.float64)
    weights = np.ones(len(points))
    for _ in range(iterations):
        distance, sigma = _distances(design, target, solution)
        weights = np.clip(1.0 - (distance / (TUKEY_C * sigma)) ** 2, 0.0, None) ** 2
        weighted = design * weights[:, None]
        solution = np.asarray(np.linalg.lstsq(weighted.T @ design, weighted.T @ target, rcond=None)[0], np.float64)
    return _summary(design, target, solution, weights)


def _distances(design: DoubleArray, target: DoubleArray, solution: DoubleArray) -> tuple[DoubleArray, float]:
    error = target - design @ solution
    sigma = MAD_TO_SIGMA * float(np.median(np.abs(error - np.median(error, axis=0))))
    return np.hypot(error[:, 0], error[:, 1]), max(sigma, MIN_SIGMA_PX)


def _summary(design: DoubleArray, target: DoubleArray, solution: DoubleArray, weights: DoubleArray) -> AffineFit:
    error = target - design @ solution
    inliers = weights > 0.0
    distance = np.hypot(error[:, 0], error[:, 1])[inliers]
    freedom = max(weights.sum() - 3.0, 1.0)
    variance = max(float((weights[:, None] * error ** 2).sum() / (2.0 * freedom)), MIN_SIGMA_PX ** 2)
    block = variance * np.linalg.pinv((design * weights[:, None]).T @ design)
    covariance = np.zeros((6, 6))
    covariance[:3, :3] = covariance[3:, 3:] = block
    residual = float(np.median(distance)) if distance.size else float('inf')
    return AffineFit(solution.T.reshape(6), covariance, inliers, residual)
