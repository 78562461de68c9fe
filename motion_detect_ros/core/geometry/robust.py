"""Robust estimation: iteratively re-weighted least squares, Tukey's weights, deviations from medians."""

from __future__ import annotations

from collections.abc import Callable
from typing import TypeVar

import numpy as np

from motion_detect_ros.core.types import DoubleArray

#: Tukey's tuning constant for 95 % efficiency under Gaussian noise, in standard deviations.
TUKEY_C = 4.685
#: Gaussian consistency factor of the median absolute deviation.
MAD_TO_SIGMA = 1.4826
#: Median length of a two-component error, in deviations of one component (Rayleigh's distribution): sqrt(2 ln 2).
RAYLEIGH_MEDIAN = 1.1774


Solution = TypeVar('Solution')


def reweighted(
    start: Solution, errors: Callable[[Solution], DoubleArray], weights: Callable[[DoubleArray], DoubleArray],
    solve: Callable[[Solution, DoubleArray, DoubleArray], Solution | None], rounds: int,
) -> Solution:
    """Iteratively re-weighted least squares (Holland and Welsch 1977) from a start close to the solution.

    errors: of a solution; weights: of its errors; solve: (solution, errors, weights) -> the next one by weighted least
    squares, None = converged, the last one stays. Ends after ``rounds``.
    """
    solution = start
    for _ in range(rounds):
        error = errors(solution)
        better = solve(solution, error, weights(error))
        if better is None:
            break
        solution = better
    return solution


def tukey_weights(error: DoubleArray, sigma: float = 1.0) -> DoubleArray:
    """Weights 0 .. 1 of errors, any shape, of deviation ``sigma`` (Beaton and Tukey 1974, biweight)."""
    weights: DoubleArray = np.clip(1.0 - (error / (TUKEY_C * sigma)) ** 2, 0.0, None) ** 2
    return weights


def rayleigh_sigma(distance: DoubleArray) -> float:
    """Deviation of one component from the lengths (N,) of two-component errors, in their unit."""
    return float(np.median(distance)) / RAYLEIGH_MEDIAN


def tukey_weights_of_squares(squared: DoubleArray, sigma: float) -> DoubleArray:
    """``tukey_weights`` of squared errors."""
    weights: DoubleArray = np.maximum(1.0 - squared / (TUKEY_C * sigma) ** 2, 0.0)
    weights *= weights
    return weights
