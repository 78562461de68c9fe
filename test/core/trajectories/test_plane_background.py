"""The motion of a plane, against exact ones and against least squares by NumPy."""

from __future__ import annotations

import numpy as np
import pytest

from motion_detect_ros.core.geometry.robust import tukey_weights
from motion_detect_ros.core.trajectories.plane_background import plane_is_better, plane_motion

WIDTH, HEIGHT = 640, 360
COEFFICIENTS = np.array([0.5, 1.2, -0.4, -0.3, 0.2, 0.9, 0.7, -0.6])
POINTS = (np.random.default_rng(5).random((800, 2)) * [WIDTH, HEIGHT]).astype(np.float32)


@pytest.fixture
def random() -> np.random.Generator:
    return np.random.default_rng(5)


def design(points: np.ndarray) -> np.ndarray:
    """(2 N, 8), all dx then all dy: Bergen et al. 1992, equation 8."""
    x, y = (points.astype(float).T - [[WIDTH / 2], [HEIGHT / 2]]) / (WIDTH / 2)
    one, zero = np.ones(len(x)), np.zeros(len(x))
    return np.concatenate([np.stack([one, x, y, zero, zero, zero, x * x, x * y], axis=1),
                           np.stack([zero, zero, zero, one, x, y, x * y, y * y], axis=1)])


def motion(points: np.ndarray) -> np.ndarray:
    return (design(points) @ COEFFICIENTS).reshape(2, -1).T


def test_an_exact_plane_is_found_though_a_fifth_of_the_points_move_on_their_own(random: np.random.Generator) -> None:
    residual = motion(POINTS)
    residual[::5] += random.normal([6.0, -4.0], 1.0, (160, 2))
    places = POINTS[:50] + np.float32(3.0)
    np.testing.assert_allclose(plane_motion(POINTS, residual, places, WIDTH, HEIGHT), motion(places), atol=1e-5)


def test_it_is_the_least_squares_fit_with_tukey_weights(random: np.random.Generator) -> None:
    residual = motion(POINTS) + random.standard_t(2.0, (800, 2)) * 0.3
    basis, wanted, weight = design(POINTS), residual.T.ravel(), np.ones(800)
    for _ in range(6):
        root = np.sqrt(np.tile(weight, 2))
        coefficients = np.linalg.lstsq(basis * root[:, None], wanted * root, rcond=None)[0]
        length = np.linalg.norm((wanted - basis @ coefficients).reshape(2, -1), axis=0)
        weight = tukey_weights(length, max(0.05, float(np.median(length)) / 1.1774))
    expected = (basis @ coefficients).reshape(2, -1).T
    np.testing.assert_allclose(plane_motion(POINTS, residual, POINTS, WIDTH, HEIGHT), expected, atol=1e-6)
    assert np.abs(expected - motion(POINTS)).max() > 1e-3  # noise does change it


def test_a_plane_is_better_where_there_is_one(random: np.random.Generator) -> None:
    noise = random.normal(0.0, 0.2, (800, 2))
    assert plane_is_better(POINTS, motion(POINTS) + noise, WIDTH, HEIGHT)
    assert not plane_is_better(POINTS, noise, WIDTH, HEIGHT)
    assert not plane_is_better(POINTS[:50], motion(POINTS[:50]), WIDTH, HEIGHT)  # too few to tell
