"""What the background does beyond the affine: a smooth correction, and how noisy the flow is.

A tilted ground plane seen from a flying camera moves by a quadratic of the image coordinates (Longuet-Higgins and
Prazdny 1980; Bergen et al. 1992, equation 8); an affine leaves up to several pixels of it in the corners.
"""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np

from motion_detect_ros.core.config import BackgroundConfig
from motion_detect_ros.core.robust_fit import TUKEY_C
from motion_detect_ros.core.types import BoolArray, DoubleArray, FloatArray

#: Cells used for the fit at most; more would not change it.
MAX_SAMPLES = 4000
#: Re-weighting rounds; the fit is stable after four to six.
ITERATIONS = 6
#: Fewer valid cells than this say nothing about the background.
MIN_CELLS = 50
#: Cells around an object whose flow may be the object's, windows tried to fill, share of known cells a window needs.
GUARD_CELLS, FILL_CELLS, MIN_FILL_SHARE = 2, (9, 17, 33, 65, 129), 0.02


@dataclass(frozen=True)
class Background:
    """``flow``: (gh, gw, 2) residual flow of the background; ``sigma_px``: (gh, gw) its noise, one deviation.

    ``smooth``: one surface, known everywhere; else each cell's flow is that of the static point closest to what was
    measured there, which says little about what an object hides.
    """

    flow: FloatArray
    sigma_px: FloatArray
    smooth: bool = True

    def behind(self, moving: BoolArray) -> Background:
        """The background with the cells of objects (gh, gw) filled from their surroundings.

        Normalised convolution (Knutsson and Westin 1993) with growing windows, so that the nearest known cells count.
        """
        if self.smooth:
            return self
        guard = np.ones((2 * GUARD_CELLS + 1, 2 * GUARD_CELLS + 1), np.uint8)
        hidden = (cv2.dilate(moving.astype(np.uint8), guard) > 0) | ~np.isfinite(self.flow[..., 0])
        seen = (~hidden).astype(np.float32)
        known = np.where(hidden[..., None], np.float32(0.0), self.flow)
        filled = known.copy()
        for size in FILL_CELLS:
            share = cv2.blur(seen, (size, size))
            reached = hidden & (share > MIN_FILL_SHARE)
            filled[reached] = (cv2.blur(known, (size, size))[reached]) / share[reached][:, None]
            hidden &= ~reached
        return Background(filled, self.sigma_px, smooth=False)


def fit_background(residual: FloatArray, config: BackgroundConfig, magnitude: FloatArray) -> Background:
    """Robust quadratic fit of the residual flow.

    residual: (gh, gw, 2) pixels, NaN = invalid; magnitude: (gh, gw) length of the camera-caused flow, pixels.
    The noise is the measured spread of the fit plus a share of the camera's flow, never under ``noise_floor_px``.
    """
    rows, columns = residual.shape[:2]
    basis = _quadratic_basis(rows, columns)
    valid = np.isfinite(residual[..., 0])
    if valid.sum() < MIN_CELLS:
        return Background(np.zeros_like(residual), np.full((rows, columns), np.inf, np.float32))
    step = max(1, int(valid.sum()) // MAX_SAMPLES)
    design = basis[valid][::step]
    target = residual[valid][::step].astype(np.float64)
    solution, sigma = _irls(design, target)
    flow = (basis.reshape(-1, 6) @ solution).reshape(rows, columns, 2).astype(np.float32)
    base = max(config.noise_floor_px, sigma)
    return Background(flow, (base + config.noise_share * magnitude).astype(np.float32))


def _quadratic_basis(rows: int, columns: int) -> DoubleArray:
    x, y = np.meshgrid(np.linspace(-1.0, 1.0, columns), np.linspace(-1.0, 1.0, rows))
    return np.stack([np.ones_like(x), x, y, x * x, x * y, y * y], axis=-1)


def _irls(design: DoubleArray, target: DoubleArray) -> tuple[DoubleArray, float]:
    """Tukey-weighted least squares from the median; returns (6, 2) coefficients and sigma of one component."""
    solution: DoubleArray = np.zeros((6, 2))
    solution[0] = np.median(target, axis=0)
    for _ in range(ITERATIONS):
        error = target - design @ solution
        distance = np.hypot(error[:, 0], error[:, 1])
        sigma = rayleigh_sigma(distance)
        weights = np.clip(1.0 - (distance / (TUKEY_C * max(sigma, 1e-3))) ** 2, 0.0, None) ** 2
        weighted = design * weights[:, None]
        solution = np.asarray(np.linalg.lstsq(weighted.T @ design, weighted.T @ target, rcond=None)[0], np.float64)
    error = target - design @ solution
    return solution, rayleigh_sigma(np.hypot(error[:, 0], error[:, 1]))


def rayleigh_sigma(distance: DoubleArray) -> float:
    """Deviation of one component from the median length of a two-component error (median = 1.1774 sigma)."""
    return float(np.median(distance)) / 1.1774
