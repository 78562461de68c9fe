"""The ground plane against planes that are known."""

from __future__ import annotations

import numpy as np

from motion_detect_ros.core.geometry import ground_plane
from motion_detect_ros.core.geometry.ground_plane import GroundPlane, fit_ground, ground_below


def _points(random: np.random.Generator, count: int = 2000) -> np.ndarray:
    return np.column_stack([random.uniform(-0.6, 0.6, count), random.uniform(0.02, 0.4, count)])


def test_plane_is_found_under_obstacles_and_noise():
    random = np.random.default_rng(1)
    points = _points(random)
    true = np.array([0.01, 0.6, -0.003])
    inverse = points @ true[:2] + true[2]
    sigma = np.full(len(points), 0.004)
    inverse += random.normal(0.0, 0.004, len(points))
    standing = random.random(len(points)) < 0.35
    inverse[standing] += random.uniform(0.03, 0.3, int(standing.sum()))
    ground = fit_ground(points, inverse, sigma)
    assert np.allclose(ground.coefficients, true, atol=[0.003, 0.006, 0.001])


def test_points_agree_up_to_two_deviations():
    random = np.random.default_rng(6)
    rows, plane = random.normal(size=(500, 3)), np.array([0.02, 0.5, 0.01])
    error = random.normal(0.0, 3.0, 500)
    assert ground_plane._agreeing(rows, rows @ plane + error, plane) == np.count_nonzero(np.abs(error) < 2.0)


def test_ground_is_that_of_the_marked_points_in_front():
    random = np.random.default_rng(7)
    points = _points(random, 6000).reshape(60, 100, 2)
    inverse = 0.5 * points[..., 1] + 0.01
    below = np.zeros((60, 100), bool)
    below[20:] = True
    inverse[:20], inverse[20:40, ::2] = 0.9, -1.0
    ground = ground_below(points, inverse, np.full((60, 100), 500.0), below)
    np.testing.assert_allclose(ground.coefficients, [0.0, 0.5, 0.01], atol=1e-6)


def test_points_that_are_not_marked_do_not_count_however_many_they_are():
    points = _points(np.random.default_rng(8), 900)
    below = np.arange(900) % 3 == 0
    inverse = np.where(below, 0.5 * points[:, 1] + 0.01, 0.1 * points[:, 0] + 0.9 * points[:, 1] + 0.2)
    ground = ground_below(points, inverse, np.full(900, 500.0), below)
    np.testing.assert_allclose(ground.coefficients, [0.0, 0.5, 0.01], atol=1e-6)


def test_limit_is_slack_behind_the_plane():
    """15 % farther away, and a hundredth of a radian below: by hand for inverse depth 3 x + 4 y + 0.5."""
    np.testing.assert_allclose(GroundPlane(np.array([3.0, 4.0, 0.5])).limit, [2.55, 3.4, 0.425 - 0.05])


def test_no_plane_where_nothing_agrees():
    random = np.random.default_rng(3)
    points = _points(random)
    assert fit_ground(points, random.uniform(0.0, 1.0, len(points)), np.full(len(points), 0.003)) is None


def test_ceiling_is_not_ground():
    random = np.random.default_rng(4)
    points = _points(random)
    assert fit_ground(points, 0.5 - 0.6 * points[:, 1], np.full(len(points), 0.003)) is None


def test_too_few_points():
    assert fit_ground(np.zeros((10, 2)), np.zeros(10), np.ones(10)) is None
