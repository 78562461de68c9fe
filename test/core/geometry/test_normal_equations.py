"""Against NumPy's solver."""

from __future__ import annotations

import numpy as np
import pytest

from motion_detect_ros.core.geometry.normal_equations import solve, tukey_sums


@pytest.mark.parametrize('count', [1, 2, 6, 8])
def test_solution_is_numpy_s(count: int) -> None:
    random = np.random.default_rng(count)
    design, right = random.normal(size=(count, 40)), random.normal(size=count)
    normal, solution = np.tril(design @ design.T), right.copy()  # the upper half is not looked at
    assert solve(normal, solution)
    np.testing.assert_allclose(solution, np.linalg.solve(design @ design.T, right), rtol=1e-9)


@pytest.mark.parametrize('normal', [np.zeros((2, 2)), np.ones((2, 2)), -np.eye(2), np.full((2, 2), np.nan)])
def test_singular_equations_have_no_solution(normal: np.ndarray) -> None:
    assert not solve(normal, np.ones(2))


@pytest.mark.parametrize('count', [3, 5])
def test_sums_are_those_of_least_squares_with_tukey_s_weights(count: int) -> None:
    random = np.random.default_rng(count)
    rows, errors = random.normal(size=(200, count)), random.normal(0.0, 2.0, 200)
    weights = np.where(np.abs(errors) < 3.0, (1.0 - (errors / 3.0) ** 2) ** 2, 0.0)
    normal, right = np.full((count, count), np.nan), np.full(count, np.nan)
    tukey_sums(rows, errors, 3.0, normal, right)
    np.testing.assert_allclose(normal, rows.T @ (weights[:, None] * rows), rtol=1e-9, atol=1e-9)
    np.testing.assert_allclose(right, rows.T @ (weights * errors), rtol=1e-9, atol=1e-9)
