"""Direct registration: the warp with the least grey-value error between two images, without features.

Inverse compositional Lucas-Kanade (Baker and Matthews 2004, section 3.2) with Tukey weights and, as the camera's
exposure may change, a gain and an offset of the grey values (Bartoli 2008). All in pixels of the two images.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import NamedTuple

import cv2
import numpy as np

from motion_detect_ros.core.geometry.motion_models import (
    ModelFamily,
    displacement,
    jacobian,
    matrix_theta,
    normalised,
    theta_matrix,
)
from motion_detect_ros.core.geometry.robust import MAD_TO_SIGMA, reweighted, tukey_weights
from motion_detect_ros.core.geometry.warp import inverse
from motion_detect_ros.core.kernels import kernel
from motion_detect_ros.core.types import BoolArray, DoubleArray, FloatArray

#: Pixels used at most: the strongest gradient of every cell of a grid with as many cells.
MAX_PIXELS = 8_000
#: Weaker gradients are noise, grey levels per pixel.
MIN_GRADIENT = 2.0
#: Distance of used pixels from the border.
BORDER_PX = 2
#: Least noise of the grey values.
MIN_SIGMA_GRAY = 0.5
#: A step that moves no corner farther than this ends the search, pixels.
CONVERGED_PX = 0.003
#: Condition of the normal equations from which the pixels do not determine the warp.
MAX_CONDITION = 1e8
#: Gain and offset of the grey values under constant exposure.
NO_CHANGE = np.array([1.0, 0.0])
#: Share of the pixels that must lie on the other image.
MIN_OVERLAP = 0.3


@dataclass(frozen=True)
class Template:
    """The pixels of the earlier image that are registered.

    ``points``: (N, 2) pixels, ``values``: (N,) grey, ``gradients``: (N, 2) grey per pixel; ``centre``: (2,) of the
    image.
    """

    points: FloatArray
    values: DoubleArray
    gradients: DoubleArray
    centre: DoubleArray


@dataclass(frozen=True)
class Registration:
    """``matrix``: (3, 3) earlier pixel -> later pixel; ``correlation``: of the grey values under it, all pixels.

    ``covariance``: (8, 8) of theta (``motion_models``); ``inliers``: (N,) bool; ``residual_px``: median distance that
    the inliers' difference in grey stands for.
    """

    matrix: DoubleArray
    covariance: DoubleArray
    correlation: float
    inliers: BoolArray
    residual_px: float


def make_template(image: FloatArray, mask: BoolArray | None = None) -> Template:
    """The strongest gradients of ``image``, (h, w) float32, spread evenly; none where ``mask`` (h, w) is False."""
    height, width = image.shape
    gx = cv2.Sobel(image, cv2.CV_32F, 1, 0, ksize=3, scale=1.0 / 8.0)
    gy = cv2.Sobel(image, cv2.CV_32F, 0, 1, ksize=3, scale=1.0 / 8.0)
    strength = np.sqrt(gx * gx + gy * gy)  # cv2.magnitude rounds as arrays are aligned
    inside = np.zeros(image.shape, np.bool_)
    inside[BORDER_PX:-BORDER_PX, BORDER_PX:-BORDER_PX] = True
    if mask is not None:
        inside &= cv2.erode(mask.view(np.uint8), np.ones((3, 3), np.uint8)) > 0
    strength[~inside] = 0.0
    cell = max(1, math.ceil(math.sqrt(height * width / MAX_PIXELS)))
    rows, columns = height // cell, width // cell
    blocks = strength[:rows * cell, :columns * cell].reshape(rows, cell, columns, cell).swapaxes(1, 2)
    best = blocks.reshape(rows, columns, -1).argmax(axis=2)
    y = (np.arange(rows)[:, None] * cell + best // cell).ravel()
    x = (np.arange(columns)[None] * cell + best % cell).ravel()
    strong = strength[y, x] >= MIN_GRADIENT
    y, x = y[strong], x[strong]
    return Template(
        np.column_stack([x, y]).astype(np.float32), image[y, x].astype(np.float64),
        np.column_stack([gx[y, x], gy[y, x]]).astype(np.float64), np.array([width / 2.0, height / 2.0]))


def align(
    template: Template, image: FloatArray, family: ModelFamily, start: DoubleArray, rounds: int,
) -> DoubleArray | None:
    """(3, 3) warp from the template's image to ``image``, (h, w) float32; None where the pixels do not determine it.

    start: earlier pixel -> later pixel, wrong by a few pixels at most; rounds: steps at most.
    """
    descent = _steepest_descent(template, family)
    corners = normalised(_corners(template.centre), template.centre)

    def solve(warp: _Warp, errors: DoubleArray, weights: DoubleArray) -> _Warp | None:
        system = _solve(descent, template.values, errors, weights)
        if system is None:
            return _Warp(np.full((3, 3), np.nan), warp.light)
        step = family.basis @ system[:-2]
        if np.abs(displacement(family, step, corners, template.centre)).max() < CONVERGED_PX:
            return None
        matrix = warp.matrix @ inverse(theta_matrix(step, template.centre))
        return _Warp(matrix / matrix[2, 2], warp.light + system[-2:])

    warp = reweighted(_Warp(start, NO_CHANGE), lambda warp: _errors(template, image, warp), _weights, solve, rounds)
    return warp.matrix if np.isfinite(warp.matrix).all() else None


def assess(template: Template, image: FloatArray, family: ModelFamily, matrix: DoubleArray) -> Registration | None:
    """How well ``matrix``, from ``align``, explains ``image``; None where it does not at all.

    The covariance is that of weighted least squares with the variance of the grey values measured on the inliers.
    """
    descent = _steepest_descent(template, family)
    errors = _errors(template, image, _Warp(matrix, NO_CHANGE))
    light = _solve(descent, template.values, errors, _weights(errors))
    if light is None:
        return None
    errors = _errors(template, image, _Warp(matrix, NO_CHANGE + light[-2:]))
    weights = _weights(errors)
    errors = np.nan_to_num(errors)
    normal, inliers = (descent * weights[:, None]).T @ descent, weights > 0.0
    if not inliers.any() or np.linalg.cond(normal) > MAX_CONDITION:
        return None
    freedom = max(weights.sum() - descent.shape[1] - len(NO_CHANGE), 1.0)
    variance = max(float((weights * errors ** 2).sum() / freedom), MIN_SIGMA_GRAY ** 2)
    spread = _composed_derivative(matrix, template.centre) @ family.basis
    later = _sampled(image, template.points, matrix)
    seen = np.isfinite(later)
    with np.errstate(divide='ignore', invalid='ignore'):  # a plain image correlates with nothing: NaN
        correlation = float(np.corrcoef(template.values[seen], later[seen])[0, 1])
    distance = np.abs(errors) / np.hypot(template.gradients[:, 0], template.gradients[:, 1])
    return Registration(matrix, variance * spread @ np.linalg.inv(normal) @ spread.T, correlation, inliers,
                        float(np.median(distance[inliers])))


def _steepest_descent(template: Template, family: ModelFamily) -> DoubleArray:
    """(N, k) change of the template's grey values with the family's free parameters, at no motion."""
    x = normalised(template.points, template.centre)
    slopes = jacobian(family, np.zeros(8), x, template.centre) @ family.basis
    descent: DoubleArray = np.einsum('ni,nik->nk', template.gradients, slopes)
    return descent


class _Warp(NamedTuple):
    """(3, 3) earlier pixel -> later pixel, and gain and offset of the grey values."""

    matrix: DoubleArray
    light: DoubleArray


def _errors(template: Template, image: FloatArray, warp: _Warp) -> DoubleArray:
    """(N,) later grey less the template's, NaN outside."""
    return _sampled(image, template.points, warp.matrix) - (warp.light[0] * template.values + warp.light[1])


def _weights(errors: DoubleArray) -> DoubleArray:
    """(N,) Tukey's, 0 outside; all 0 where too little lies on the other image."""
    known = np.isfinite(errors)
    if known.sum() <= MIN_OVERLAP * len(errors):
        return np.zeros(len(errors))
    sigma = max(MAD_TO_SIGMA * float(np.median(np.abs(errors[known] - np.median(errors[known])))), MIN_SIGMA_GRAY)
    return np.nan_to_num(tukey_weights(errors, sigma))


def _solve(
    descent: DoubleArray, values: DoubleArray, errors: DoubleArray, weights: DoubleArray,
) -> DoubleArray | None:
    """(k + 2,) step of the warp, gain and offset; errors that are not known have weight 0."""
    errors = np.nan_to_num(errors)
    design = np.column_stack([descent, values, np.ones(len(values))])
    weighted = design * weights[:, None]
    normal = weighted.T @ design
    scale = np.sqrt(np.diag(normal))
    if not scale.min(initial=np.inf) > 0.0 or np.linalg.cond(normal / np.outer(scale, scale)) > MAX_CONDITION:
        return None
    return np.asarray(np.linalg.solve(normal, weighted.T @ errors), np.float64)


def _composed_derivative(matrix: DoubleArray, centre: DoubleArray) -> DoubleArray:
    """(8, 8) change of theta of ``matrix`` with the theta of a small warp that is undone before it."""
    small = 1e-3
    return np.column_stack([
        (matrix_theta(matrix @ inverse(theta_matrix(step, centre)), centre) - matrix_theta(matrix, centre)) / small
        for step in small * np.eye(8)])


def _corners(centre: DoubleArray) -> FloatArray:
    right, bottom = 2.0 * centre
    return np.array([[0.0, 0.0], [right, 0.0], [0.0, bottom], [right, bottom]], np.float32)


def _sampled(image: FloatArray, points: FloatArray, matrix: DoubleArray) -> DoubleArray:
    """(N,) grey of ``image`` where ``matrix`` carries ``points``; NaN outside."""
    ahead = points.astype(np.float64) @ matrix[:, :2].T + matrix[:, 2]
    out = np.empty(len(points))
    _cubic(image, ahead[:, 0] / ahead[:, 2], ahead[:, 1] / ahead[:, 2], out)
    return out


@kernel()
def _cubic(image, x, y, out):  # type: ignore[no-untyped-def]
    """Cubic convolution (Keys 1981, a = -1/2)."""
    height, width = image.shape
    for i in range(x.shape[0]):
        if not (x[i] >= 1.0 and y[i] >= 1.0 and x[i] < width - 2.0 and y[i] < height - 2.0):
            out[i] = np.nan
            continue
        column, row = int(x[i]), int(y[i])
        s, t = x[i] - column, y[i] - row
        total = 0.0
        wx = (((-0.5 * s + 1.0) * s - 0.5) * s, (1.5 * s - 2.5) * s * s + 1.0,
              ((-1.5 * s + 2.0) * s + 0.5) * s, (0.5 * s - 0.5) * s * s)
        wy = (((-0.5 * t + 1.0) * t - 0.5) * t, (1.5 * t - 2.5) * t * t + 1.0,
              ((-1.5 * t + 2.0) * t + 0.5) * t, (0.5 * t - 0.5) * t * t)
        for j in range(4):
            line = 0.0
            for k in range(4):
                line += wx[k] * image[row - 1 + j, column - 1 + k]
            total += wy[j] * line
        out[i] = total
