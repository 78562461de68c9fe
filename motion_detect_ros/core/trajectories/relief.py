"""Scenes in relief, a street between houses: residuals along the lines to their common epipole, and across them."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt
from scipy.linalg import lapack

from motion_detect_ros.core.geometry.order_statistics import median
from motion_detect_ros.core.geometry.robust import MAD_TO_SIGMA
from motion_detect_ros.core.geometry.vectors import magnitude
from motion_detect_ros.core.kernels import kernel
from motion_detect_ros.core.types import DoubleArray, FloatArray

#: The common epipole: rounds of re-weighting, points used, percentile of the lengths from which they count, errors over
#: so many deviations do not count, least deviation (normalised, and of a length in pixels).
EPIPOLE_ROUNDS, EPIPOLE_POINTS, SHORT_PERCENTILE, OUTLIER_SIGMAS, LEAST_SIGMA, LEAST_PX = 8, 1000, 30.0, 6.0, 0.02, 1e-3


@dataclass(frozen=True)
class EpipolarParts:
    """Residuals along and across the lines to their common epipole: (N,) lengths and their deviations, pixels."""

    along: DoubleArray
    across: DoubleArray
    along_sigma: float
    across_sigma: float

    @property
    def relief(self) -> float:
        """How much longer residuals are along the lines: about 1 on a plane, 2 and more in a street."""
        return self.along_sigma / self.across_sigma


def epipolar_parts(
    points: FloatArray, error: DoubleArray, sample: npt.NDArray[np.intp], width: int, height: int,
) -> EpipolarParts:
    """points, error: (N, 2) pixels; sample: (n,) indices of those that epipole and deviations are taken from."""
    x, y = ((points[sample].astype(np.float64) - [width / 2.0, height / 2.0]) / (width / 2.0)).T
    along, across = np.empty((2, len(points)))
    _parts(points, error, width, height, _epipole(x, y, error[sample]), along, across)
    across_sigma = max(LEAST_PX, MAD_TO_SIGMA * median(across[sample]))
    along_sigma = max(across_sigma, MAD_TO_SIGMA * median(along[sample]))
    return EpipolarParts(along, across, along_sigma, across_sigma)


def _epipole(x: DoubleArray, y: DoubleArray, error: DoubleArray) -> DoubleArray:
    """(3,) homogeneous (a, b, c): residuals point from (x, y) to (a, b) / c or away from it. Robust (IRLS)."""
    length = magnitude(error)
    rank = int(SHORT_PERCENTILE / 100.0 * (len(length) - 1))
    used = np.flatnonzero(length > np.partition(length, rank)[rank])
    if not len(used):  # all residuals are alike, those of a camera that stands
        return np.array([1.0, 0.0, 0.0])
    used = used[::max(1, len(used) // EPIPOLE_POINTS)]
    x, y, error, length = x[used], y[used], error[used], np.maximum(length[used], LEAST_PX)
    lines = np.stack([error[:, 1], -error[:, 0], error[:, 0] * y - error[:, 1] * x], axis=1)
    weighted, scratch = lines / length[:, None], np.empty((3, len(lines)))
    normal = weighted.T @ weighted
    epipole: DoubleArray = lapack.dsyev(normal)[1][:, 0]
    for _ in range(EPIPOLE_ROUNDS - 1):
        _weighted_lines(x, y, lines, length, epipole, scratch, normal)
        epipole = lapack.dsyev(normal)[1][:, 0]
    return epipole


@kernel()
def _weighted_lines(x, y, lines, length, epipole, scratch, normal):  # type: ignore[no-untyped-def]
    """``normal``: (3, 3) weighted sum of the outer products of ``lines`` (n, 3).

    x, y: (n,) places, normalised; length: (n,) of the residuals, pixels; epipole: (3,); scratch: (3, n).
    """
    a, b, c = epipole[0], epipole[1], epipole[2]
    reach, off = scratch[0], scratch[1]
    for n in range(len(x)):
        u, v = a - c * x[n], b - c * y[n]
        reach[n] = math.sqrt(u * u + v * v) + 1e-6
        off[n] = scratch[2, n] = abs(lines[n, 0] * a + lines[n, 1] * b + lines[n, 2] * c) / reach[n]
    sigma = max(LEAST_SIGMA, MAD_TO_SIGMA * median(scratch[2]))
    normal[:] = 0.0
    for n in range(len(x)):
        if off[n] < OUTLIER_SIGMAS * sigma:
            weight = 1.0 / (reach[n] * reach[n] * max(1.0, off[n] / sigma) * max(length[n], sigma))
            for i in range(3):
                for j in range(3):
                    normal[i, j] += weight * lines[n, i] * lines[n, j]


@kernel()
def _parts(points, error, width, height, epipole, along, across):  # type: ignore[no-untyped-def]
    """``along``, ``across``: (N,) pixels of ``error`` (N, 2) at points (N, 2), pixels. epipole: (3,) normalised."""
    half_width, half_height = 0.5 * width, 0.5 * height
    a, b, c = epipole[0], epipole[1], epipole[2]
    for n in range(len(points)):
        u = a - c * ((points[n, 0] - half_width) / half_width)
        v = b - c * ((points[n, 1] - half_height) / half_width)
        length = max(math.sqrt(u * u + v * v), 1e-6)
        along[n] = abs(error[n, 0] * u + error[n, 1] * v) / length
        across[n] = abs(error[n, 1] * u - error[n, 0] * v) / length
