"""Background flow beyond the ego-motion, and the noise of the flow.

A tilted ground plane seen from a flying camera moves by a quadratic of the image coordinates (Longuet-Higgins and
Prazdny 1980; Bergen et al. 1992, equation 8); an affine leaves up to several pixels of it in the corners.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import cv2
import numpy as np

from motion_detect_ros.core.background.filling import filled_from_around
from motion_detect_ros.core.config import BackgroundConfig
from motion_detect_ros.core.geometry.order_statistics import column_medians, select
from motion_detect_ros.core.geometry.robust import reweighted, tukey_weights_of_squares
from motion_detect_ros.core.types import BoolArray, DoubleArray, FloatArray

#: Maximum number of cells used for the fit; more do not change it.
MAX_SAMPLES = 4000
#: Re-weighting rounds; the fit is stable after four to six.
ITERATIONS = 6
#: Least deviation that the weights assume, pixels.
MIN_SIGMA_PX = 1e-3
#: The ego-motion alone is the background where it brings this share of the cells so many times as close as the fit.
NEAR_SHARE, CLOSER = 0.15, 1.15
#: Share of its trace added to the normal matrix: points on one line do not determine a surface.
RIDGE = 1e-10
#: Least number of valid cells.
MIN_CELLS = 50
#: Cells around an object whose flow may be the object's.
GUARD_CELLS = 2


@dataclass(frozen=True)
class Background:
    """``flow``: (gh, gw, 2) residual flow of the background; ``sigma_px``: (gh, gw) its noise, one deviation.

    ``smooth``: one surface, known everywhere; else each cell's flow is that of the static point closest to what was
    measured there, which is not the background behind an object. ``spread_px``: the measured part of the noise, one
    component, without floor and share; NaN where nothing was measured.
    """

    flow: FloatArray
    sigma_px: FloatArray
    smooth: bool = True
    spread_px: float = math.nan

    def behind(self, moving: BoolArray) -> Background:
        """The background with the cells of objects (gh, gw) filled from their surroundings."""
        if self.smooth:
            return self
        guard = np.ones((2 * GUARD_CELLS + 1, 2 * GUARD_CELLS + 1), np.uint8)
        hidden = (cv2.dilate(moving.astype(np.uint8), guard) > 0) | ~np.isfinite(self.flow[..., 0])
        filled = filled_from_around(self.flow, hidden)
        return Background(filled, self.sigma_px, smooth=False, spread_px=self.spread_px)


def motion_vectors(residual: FloatArray, background: Background) -> FloatArray:
    """(gh, gw, 2) motion against the background in units of its noise; NaN where the flow is unknown.

    residual: (gh, gw, 2) flow without the ego-motion, pixels.
    """
    vectors: FloatArray = residual - background.flow
    vectors[..., 0] /= background.sigma_px
    vectors[..., 1] /= background.sigma_px
    return vectors


def fit_background(residual: FloatArray, config: BackgroundConfig, magnitude: FloatArray) -> Background:
    """Robust quadratic fit of the residual flow; zero flow where more cells are close to the ego-motion alone.

    residual: (gh, gw, 2) pixels, NaN = invalid; magnitude: (gh, gw) length of the total flow, pixels.
    The noise is the measured spread of the fit, at least ``noise_floor_px``, plus a share of the total flow. Lanes of
    traffic are over half of the cells: a fit to their mixture is nothing's motion, and its spread hides them.
    """
    rows, columns = residual.shape[:2]
    valid = np.flatnonzero(np.isfinite(residual[..., 0]))
    if valid.size < MIN_CELLS:
        return Background(np.zeros_like(residual), np.full((rows, columns), np.inf, np.float32))
    used = valid[::-(-valid.size // MAX_SAMPLES)]
    x, y = np.linspace(-1.0, 1.0, columns), np.linspace(-1.0, 1.0, rows)
    across, down = x[used % columns], y[used // columns]
    design = np.stack([np.ones_like(across), across, down, across * across, across * down, down * down])
    solution, sigma = _irls(design, residual.reshape(-1, 2)[used].T.astype(np.float64, order='C'))
    base = max(config.noise_floor_px, sigma)
    sigma_px = (base + config.noise_share * magnitude).astype(np.float32)
    return Background(_surface(solution, x, y), sigma_px, spread_px=sigma)


def _surface(solution: DoubleArray, x: DoubleArray, y: DoubleArray) -> FloatArray:
    """(len(y), len(x), 2) float32: the quadratic with coefficients (6, 2) of 1, x, y, x^2, x y, y^2."""
    columns, rows = len(x), y.astype(np.float32)[:, None]
    across = np.stack([np.ones_like(x), x, x * x], axis=1)
    level = (across @ solution[[0, 1, 3]]).astype(np.float32).ravel()
    slope = (across[:, :2] @ solution[[2, 4]]).astype(np.float32).ravel()
    bend = np.tile(solution[5].astype(np.float32), columns)
    flow: FloatArray = bend * rows
    flow += slope
    flow *= rows
    flow += level
    return flow.reshape(len(y), columns, 2)


def _irls(design: DoubleArray, target: DoubleArray) -> tuple[DoubleArray, float]:
    """Tukey-weighted least squares from the median; returns (6, 2) coefficients and sigma of one component.

    Zeros where these are the better of the two by a low quantile of the errors (Rousseeuw 1984).

    design: (6, N), coordinates within -1 .. 1, so that the normal equations are safe; target: (2, N).
    """
    def squared_errors(solution: DoubleArray) -> DoubleArray:
        return _squared_error(design, target, solution)

    def weights(squared: DoubleArray) -> DoubleArray:
        return tukey_weights_of_squares(squared, max(_sigma(squared), MIN_SIGMA_PX))

    def solve(_: DoubleArray, squared: DoubleArray, weights: DoubleArray) -> DoubleArray:
        weighted = design * weights
        normal = weighted @ design.T
        normal.flat[::7] += RIDGE * normal.trace()
        return np.asarray(np.linalg.solve(normal, weighted @ target.T), np.float64)

    start: DoubleArray = np.zeros((6, 2))
    start[0] = column_medians(target.T)
    solution = reweighted(start, squared_errors, weights, solve, ITERATIONS)
    squared, alone = squared_errors(solution), squared_errors(np.zeros((6, 2)))
    if CLOSER * CLOSER * _quantile(alone, NEAR_SHARE) < _quantile(squared, NEAR_SHARE):
        return np.zeros((6, 2)), _sigma(alone, NEAR_SHARE)
    return solution, _sigma(squared)


def _squared_error(design: DoubleArray, target: DoubleArray, solution: DoubleArray) -> DoubleArray:
    error = target - solution.T @ design
    error *= error
    squared: DoubleArray = error[0] + error[1]
    return squared


def _quantile(values: DoubleArray, share: float) -> float:
    return select(values.copy(), int(share * values.size))


def _sigma(squared: DoubleArray, share: float = 0.5) -> float:
    """Deviation of one component that this quantile of squared two-component errors tells (Rayleigh's distribution)."""
    return math.sqrt(_quantile(squared, share) / (-2.0 * math.log1p(-share)))
