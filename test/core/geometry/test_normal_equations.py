"""Against NumPy."""

from __future__ import annotations

import numpy as np
import pytest

from motion_detect_ros.core.geometry.normal_equations import tukey_sums
from motion_detect_ros.core.geometry.robust import rayleigh_sigma


@pytest.mark.parametrize('count', [3, 5])
def test_sums_are_those_of_least_squares_with_tukey_s_weights(count: int) -> None:
    random = np.random.default_rng(count)
    rows, errors = random.normal(size=(200, count)), random.normal(0.0, 2.0, 200)
    weights = np.where(np.abs(errors) < 3.0, (1.0 - (errors / 3.0) ** 2) ** 2, 0.0)
    normal, right = np.full((count, count), np.nan), np.full(count, np.nan)
    tukey_sums(rows, errors, 3.0, normal, right)
    np.testing.assert_allclose(normal, rows.T @ (weights[:, None] * rows), rtol=1e-9, atol=1e-9)
    np.testing.assert_allclose(right, rows.T @ (weights * errors), rtol=1e-9, atol=1e-9)


def test_deviation_of_a_component_is_that_of_the_lengths_median() -> None:
    """Half of all lengths of two components of deviation 1 are below sqrt(2 ln 2) = 1.1774."""
    assert rayleigh_sigma(np.full(7, 1.1774)) == pytest.approx(1.0)
    assert rayleigh_sigma(np.array([900.0, 2.3548, 0.0])) == pytest.approx(2.0), 'outliers do not count'
    errors = np.random.default_rng(2).normal(0.0, 3.0, (100_000, 2))
    assert rayleigh_sigma(np.hypot(*errors.T)) == pytest.approx(3.0, rel=0.01)
