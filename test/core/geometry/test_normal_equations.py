"""Against NumPy."""

from __future__ import annotations

import numpy as np
import pytest

from motion_detect_ros.core.geometry.normal_equations import tukey_sums


@pytest.mark.parametrize('count', [3, 5])
def test_sums_are_those_of_least_squares_with_tukey_s_weights(count: int) -> None:
    random = np.random.default_rng(count)
    rows, errors = random.normal(size=(200, count)), random.normal(0.0, 2.0, 200)
    weights = np.where(np.abs(errors) < 3.0, (1.0 - (errors / 3.0) ** 2) ** 2, 0.0)
    normal, right = np.full((count, count), np.nan), np.full(count, np.nan)
    tukey_sums(rows, errors, 3.0, normal, right)
    np.testing.assert_allclose(normal, rows.T @ (weights[:, None] * rows), rtol=1e-9, atol=1e-9)
    np.testing.assert_allclose(right, rows.T @ (weights * errors), rtol=1e-9, atol=1e-9)
