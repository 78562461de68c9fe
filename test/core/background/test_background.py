"""The smooth background against surfaces that are known."""

from __future__ import annotations

import numpy as np
import pytest

from motion_detect_ros.core.background.planar import fit_background
from motion_detect_ros.core.config import BackgroundConfig

CONFIG = BackgroundConfig()


def surface(rows: int, columns: int) -> np.ndarray:
    """(rows, columns, 2) quadratic, both components different."""
    y, x = np.mgrid[-1.0:1.0:rows * 1j, -1.0:1.0:columns * 1j]
    across = 0.3 + 1.0 * x - 0.5 * y + 2.0 * x * x + 0.7 * x * y - 0.2 * y * y
    down = -0.1 + 0.4 * x + 0.9 * y - 0.6 * x * x - 1.1 * x * y + 1.5 * y * y
    return np.stack([across, down], axis=-1)


def fitted(flow: np.ndarray):
    return fit_background(flow.astype(np.float32), CONFIG, np.zeros(flow.shape[:2], np.float32))


@pytest.mark.parametrize('shape', [(12, 16), (67, 120), (135, 240)])
def test_a_quadratic_is_found_to_the_last_digit(shape):
    background = fitted(surface(*shape))
    np.testing.assert_allclose(background.flow, surface(*shape), atol=2e-5)
    np.testing.assert_allclose(background.sigma_px, CONFIG.noise_floor_px, rtol=1e-6)


def test_noise_holes_and_a_tenth_that_moves_otherwise():
    random = np.random.default_rng(0)
    truth = surface(90, 160)
    flow = truth + random.normal(0.0, 0.5, truth.shape)
    flow[20:50, 30:80] += [6.0, -4.0]
    flow[random.random((90, 160)) < 0.3] = np.nan
    background = fitted(flow)
    assert np.abs(background.flow - truth).max() < 0.15
    assert 0.5 < np.median(background.sigma_px) < 0.65  # the median of all cells, movers included


def test_a_surface_within_the_noise_is_fitted_all_the_same():
    truth = 0.1 * surface(90, 160)
    background = fitted(truth + np.random.default_rng(2).normal(0.0, 0.1, truth.shape))
    assert np.abs(background.flow - truth).max() < 0.03
    assert np.abs(truth).max() > 0.2


def test_what_a_third_of_the_cells_agrees_on_is_not_lost_among_movers():
    """Lanes in both directions: 0.36 stand still, 0.4 drive one way and 0.24 the other, at speeds of their own."""
    random = np.random.default_rng(1)
    flow = random.normal(0.0, 0.1, (100, 160, 2))
    flow[:40, :, 0] += random.uniform(1.0, 5.0, (40, 160))
    flow[40:64, :, 0] -= random.uniform(1.0, 5.0, (24, 160))
    background = fitted(flow[random.permutation(100)])
    assert np.abs(background.flow).max() < 0.2
    assert background.sigma_px.max() < 0.4


def test_cells_on_one_line_leave_no_wild_numbers_where_they_are():
    truth = surface(90, 160)
    flow = np.full_like(truth, np.nan)
    flow[40] = truth[40]
    background = fitted(flow)
    assert np.isfinite(background.flow).all()
    np.testing.assert_allclose(background.flow[40], truth[40], atol=1e-3)


def test_too_few_cells_say_nothing():
    flow = np.full((90, 160, 2), np.nan)
    flow[0, :20] = 1.0
    background = fitted(flow)
    assert not background.flow.any() and np.isinf(background.sigma_px).all()
