"""What robust estimators share: deviations from medians, and Tukey's weights."""

from __future__ import annotations

import numpy as np

from motion_detect_ros.core.types import DoubleArray

#: Tukey's tuning constant for 95 % efficiency under Gaussian noise, in standard deviations.
TUKEY_C = 4.685
#: Gaussian consistency factor of the median absolute deviation.
MAD_TO_SIGMA = 1.4826
#: Median length of a two-component error, in deviations of one component (Rayleigh's distribution): sqrt(2 ln 2).
RAYLEIGH_MEDIAN = 1.1774


def tukey_weights(error: DoubleArray, sigma: float = 1.0) -> DoubleArray:
    """Weights 0 .. 1 of errors, any shape, of deviation ``sigma`` (Beaton and Tukey 1974, biweight)."""
    weights: DoubleArray = np.clip(1.0 - (error / (TUKEY_C * sigma)) ** 2, 0.0, None) ** 2
    return weights


def rayleigh_sigma(distance: DoubleArray) -> float:
    """Deviation of one component from the lengths (N,) of two-component errors, in their unit."""
    return float(np.median(distance)) / RAYLEIGH_MEDIAN
