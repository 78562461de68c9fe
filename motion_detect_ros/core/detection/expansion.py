"""Rate of expansion of an object, from the flow of its cells."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np

from motion_detect_ros.core.detection.candidate import Candidate, Growth
from motion_detect_ros.core.geometry.order_statistics import median
from motion_detect_ros.core.geometry.robust import RAYLEIGH_MEDIAN, TUKEY_C
from motion_detect_ros.core.kernels import kernel
from motion_detect_ros.core.types import FloatArray, FlowField

#: Least number of cells of a measurement.
MIN_CELLS = 20
#: Least share of the object's motion in its cells; those with less lie on the smeared boundary to the ground.
MOTION_SHARE = 0.75
#: Re-weighting rounds, and least deviation, pixels.
ROUNDS, MIN_SIGMA_PX = 5, 0.02
#: Number of cells with correlated errors: flow is smooth over about four by four cells.
CELLS_A_PATCH = 16.0
#: Least former size, share of the present one.
MIN_SHRINKAGE = 0.1
#: A box so close to the image border may be cut by it, pixels.
BORDER_PX = 4.0


def with_growth(
    candidates: list[Candidate], flow: FlowField, object_flow: FloatArray, seconds: float,
) -> list[Candidate]:
    """The candidates with their growth, None where too few cells are known.

    flow: total flow over ``seconds``, camera motion included: contact is between camera and object; object_flow:
    (gh, gw, 2) motion against the background, pixels, which tells an object's cells from those of the background.
    What comes closer at constant speed was smaller by the factor 1 - a, a = seconds * speed / distance then, so the
    rate now is a / (seconds * (1 - a)) (Lee 1976; Koenderink and van Doorn 1976: divergence = 2 a / seconds).
    """
    if not candidates or seconds <= 0.0:
        return [replace(seen, growth=None) for seen in candidates]
    centres, sizes, motions = (np.array([getattr(seen, name) for seen in candidates])
                               for name in ('centre', 'size', 'velocity_px_s'))
    grid = flow.flow.shape[:2]
    cell = np.array([flow.width / grid[1], flow.height / grid[0]])
    low = np.maximum(np.floor((centres - sizes / 2.0) / cell), 0.0).astype(np.int64)
    high = np.minimum(np.ceil((centres + sizes / 2.0) / cell), grid[::-1]).astype(np.int64)
    most = int(np.maximum(high - low, 0).prod(axis=1).max())
    found = np.empty((len(candidates), 3))
    _fill_shrinkages(flow.flow, object_flow, motions * seconds, low, high, cell, np.empty((5, most)),
                     np.empty((2, most), np.float32), found)
    return [replace(seen, growth=_growth(seen, seconds, flow, *each)) for seen, each in zip(
        candidates, found.tolist(), strict=True)]


def _growth(
    seen: Candidate, seconds: float, flow: FlowField, shrunk: float, variance: float, cells: float,
) -> Growth | None:
    """Of what ``_shrinkage`` returns."""
    if cells < MIN_CELLS:
        return None
    before = max(1.0 - shrunk, MIN_SHRINKAGE)
    return Growth(shrunk / (seconds * before), variance / (seconds * before ** 2) ** 2, seconds,
                  _log_size(seen, flow.width, flow.height))


def _log_size(seen: Candidate, width: int, height: int) -> float:
    """Logarithm of the geometric mean of the sides; NaN where the image border cuts the box."""
    (u, v), (across, down) = seen.centre.tolist(), seen.size.tolist()
    beside = min(u - across / 2.0, v - down / 2.0, width - u - across / 2.0, height - v - down / 2.0)
    return 0.5 * math.log(across * down) if beside >= BORDER_PX else math.nan


@kernel()
def _fill_shrinkages(  # type: ignore[no-untyped-def]
    flow, object_flow, motions, low, high, cell, cells, errors, found,
):
    """``found``: (n, 3) what ``_shrinkage`` returns for motions (n, 2) of the cells ``low`` .. ``high``, (n, 2) columns
    and rows; cell: (2,) its sides; cells: (5, .), errors: (2, .) for those of the largest.
    """
    for n in range(len(found)):
        found[n, 0], found[n, 1], found[n, 2] = _shrinkage(
            flow, object_flow, motions[n, 0], motions[n, 1], low[n, 0], low[n, 1], high[n, 0], high[n, 1], cell[0],
            cell[1], cells, errors)


@kernel()
def _shrinkage(  # type: ignore[no-untyped-def]
    flow, object_flow, motion_x, motion_y, left, top, right, bottom, cell_x, cell_y, cells, errors,
):
    """Scale part a of flow = t + a p + b rot90(p) over the cells of this motion, its variance, their number.

    Least squares re-weighted by Tukey's biweight; positions about their weighted mean, so that the normal equations
    are diagonal. cells: (5, .), errors: (2, .) for the cells of the window.
    """
    x, y, u, v, weight = cells[0], cells[1], cells[2], cells[3], cells[4]
    error, ordered = errors[0], errors[1]
    least, count = MOTION_SHARE * (motion_x ** 2 + motion_y ** 2), 0
    for row in range(top, bottom):
        for column in range(left, right):
            along = object_flow[row, column, 0] * motion_x + object_flow[row, column, 1] * motion_y
            if not along >= least:  # NaN is not
                continue
            x[count], y[count] = (column + 0.5) * cell_x, (row + 0.5) * cell_y
            u[count], v[count], weight[count] = flow[row, column, 0], flow[row, column, 1], 1.0
            count += 1
    if count < MIN_CELLS:
        return 0.0, np.inf, count
    x, y, u, v, weight = x[:count], y[:count], u[:count], v[:count], weight[:count]
    scale, variance = 0.0, np.inf
    for _ in range(ROUNDS):
        scale, turn, spread, mean = _similarity(x, y, u, v, weight)
        if spread <= 0.0:
            return 0.0, np.inf, 0
        for n in range(count):
            px, py = x[n] - mean[0], y[n] - mean[1]
            error[n] = np.hypot(u[n] - mean[2] - scale * px + turn * py, v[n] - mean[3] - scale * py - turn * px)
            ordered[n] = error[n]
        sigma = max(MIN_SIGMA_PX, median(ordered[:count]) / RAYLEIGH_MEDIAN)
        variance = sigma ** 2 * CELLS_A_PATCH / spread
        for n in range(count):
            weight[n] = max(0.0, 1.0 - (error[n] / (TUKEY_C * sigma)) ** 2) ** 2
    return scale, variance, count


@kernel()
def _similarity(x, y, u, v, weight):  # type: ignore[no-untyped-def]
    """Weighted least squares: a, b, weighted spread of the positions, weighted means of x, y, u, v."""
    total = sx = sy = su = sv = 0.0
    for n in range(len(x)):
        total += weight[n]
        sx, sy = sx + weight[n] * x[n], sy + weight[n] * y[n]
        su, sv = su + weight[n] * u[n], sv + weight[n] * v[n]
    if total <= 0.0:
        return 0.0, 0.0, 0.0, (0.0, 0.0, 0.0, 0.0)
    mx, my, mu, mv = sx / total, sy / total, su / total, sv / total
    spread = along = across = 0.0
    for n in range(len(x)):
        px, py, du, dv = x[n] - mx, y[n] - my, u[n] - mu, v[n] - mv
        spread += weight[n] * (px * px + py * py)
        along += weight[n] * (px * du + py * dv)
        across += weight[n] * (px * dv - py * du)
    if spread <= 0.0:
        return 0.0, 0.0, 0.0, (mx, my, mu, mv)
    return along / spread, across / spread, spread, (mx, my, mu, mv)
