"""The cost of a model against plain NumPy."""

from __future__ import annotations

import math

import numpy as np
import pytest

from motion_detect_ros.core.background.planar import Background, motion_vectors
from motion_detect_ros.core.background.selection import _cost, _squared, _to_and_fro

RANDOM = np.random.default_rng(0)
RESIDUAL = RANDOM.normal(0.0, 2.0, (30, 40, 2)).astype(np.float32)
RESIDUAL[RANDOM.random((30, 40)) < 0.2] = np.nan
BACKGROUND = Background(RANDOM.normal(0.0, 0.5, (30, 40, 2)).astype(np.float32),
                        RANDOM.uniform(0.5, 2.0, (30, 40)).astype(np.float32))


@pytest.mark.parametrize(('dimension', 'bound'), [(2, 4.0), (3, 2.0)])
def test_cost_is_the_mean_bounded_error_and_a_penalty_for_each_dimension(dimension: int, bound: float) -> None:
    """Halfway from Torr's penalty to that of Kanatani's geometric AIC."""
    error = np.linalg.norm(RESIDUAL - BACKGROUND.flow, axis=-1) / BACKGROUND.sigma_px
    expected = np.nanmean(np.minimum(error ** 2, bound)) + dimension * (math.log(4.0) + 2.0) / 2.0
    squared = _squared(RESIDUAL, BACKGROUND, BACKGROUND.sigma_px)
    assert _cost(squared, dimension) == pytest.approx(expected, rel=1e-5)


def test_where_nothing_is_known_there_is_no_error() -> None:
    assert _cost(np.full_like(RESIDUAL[..., 0], np.nan), 2) == math.log(4.0) + 2.0


@pytest.mark.parametrize(('back', 'answer'), [(19, False), (21, True)])
def test_what_moves_back_along_the_lines_is_weighed_against_what_space_alone_explains(back: int, answer: bool) -> None:
    """Of 60 cells that space explains, a quarter of the whole is 20; what only moves across the lines is no matter."""
    off_surface, off_space, against = np.full(400, 5.0), np.full(400, 1.0), np.zeros(400, np.bool_)
    off_space[60:200] = 3.0  # neither model explains them
    against[60:60 + back] = True
    off_surface[200:] = 1.0
    against[:60] = against[200:300] = True  # within the noise
    off_space[300:] = 3.0  # the surface explains them
    against[300:] = True
    assert _to_and_fro(off_surface, off_space, against) is answer


def test_motion_is_in_units_of_each_cell_s_noise() -> None:
    np.testing.assert_array_equal(
        motion_vectors(RESIDUAL, BACKGROUND), (RESIDUAL - BACKGROUND.flow) / BACKGROUND.sigma_px[..., None])
