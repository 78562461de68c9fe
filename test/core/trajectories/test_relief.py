"""Residuals along and across the lines to an epipole that is known."""

from __future__ import annotations

import numpy as np
import pytest

from motion_detect_ros.core.trajectories.relief import EpipolarParts, _weighted_lines, epipolar_parts

WIDTH, HEIGHT = 640, 360
POINTS = (np.random.default_rng(6).random((900, 2)) * [WIDTH, HEIGHT]).astype(np.float32)


@pytest.fixture
def random() -> np.random.Generator:
    return np.random.default_rng(6)


def towards(epipole_px: tuple[float, float]) -> np.ndarray:
    """(N, 2) unit vectors."""
    lines = np.array(epipole_px) - POINTS
    return lines / np.linalg.norm(lines, axis=1)[:, None]


def parts(error: np.ndarray) -> EpipolarParts:
    return epipolar_parts(POINTS, error, np.arange(0, len(POINTS), 2), WIDTH, HEIGHT)


@pytest.mark.parametrize(('epipole_px', 'own'), [((250.0, 120.0), 90), ((-900.0, 300.0), 0), ((1e7, 180.0), 0)])
def test_parts_along_and_across_the_lines_to_the_true_epipole(
    epipole_px: tuple[float, float], own: int, random: np.random.Generator,
) -> None:
    """own: so many points move on their own, anywhere."""
    line = towards(epipole_px)
    error = random.normal(0.0, 3.0, (900, 1)) * line + random.normal(0.0, 0.02, (900, 2))
    error[:10 * own:10] = random.normal(0.0, 3.0, (own, 2))
    found = parts(error)
    far = np.linalg.norm(POINTS - epipole_px, axis=1) > 40.0  # nearer a small error of the epipole turns the line
    across = np.abs(line[:, 0] * error[:, 1] - line[:, 1] * error[:, 0])
    np.testing.assert_allclose(found.along[far], np.abs((line * error).sum(axis=1))[far], atol=0.3)
    np.testing.assert_allclose(found.across[far], across[far], atol=0.3)
    assert np.median(np.abs(found.across - across)) < 0.01
    assert found.along_sigma == pytest.approx(1.4826 * np.median(found.along[::2]))
    assert found.across_sigma == pytest.approx(1.4826 * np.median(found.across[::2]))
    assert found.relief > 10.0


def test_a_line_has_less_weight_the_farther_it_is_from_the_epipole(random: np.random.Generator) -> None:
    """And none over six deviations; a long residual has less than it would, as its line's error is larger."""
    x, y, error = random.uniform(-1.0, 1.0, 300), random.uniform(-0.6, 0.6, 300), random.normal(0.0, 1.0, (300, 2))
    epipole, length = np.array([0.3, -0.2, 0.9]), np.linalg.norm(error, axis=1)
    lines = np.stack([error[:, 1], -error[:, 0], error[:, 0] * y - error[:, 1] * x], axis=1)
    lines[::20] *= 100.0
    reach = np.hypot(epipole[0] - epipole[2] * x, epipole[1] - epipole[2] * y)
    off = np.abs(lines @ epipole) / reach
    sigma = 1.4826 * np.median(off)
    weight = 1.0 / (reach ** 2 * np.maximum(1.0, off / sigma) * np.maximum(length, sigma))
    weight[off >= 6.0 * sigma] = 0.0
    normal = np.empty((3, 3))
    _weighted_lines(x, y, lines, length, epipole, np.empty((3, 300)), normal)
    np.testing.assert_allclose(normal, lines.T @ (weight[:, None] * lines), rtol=1e-3)
    assert 0 < (weight == 0.0).sum() < 30


def test_the_parts_make_up_the_whole(random: np.random.Generator) -> None:
    error = random.normal(0.0, 1.0, (900, 2))
    found = parts(error)
    np.testing.assert_allclose(np.hypot(found.along, found.across), np.linalg.norm(error, axis=1), rtol=1e-9)
    assert found.relief < 1.5


def test_nothing_that_moves_has_no_relief() -> None:
    found = parts(np.zeros((900, 2)))
    assert found.relief == 1.0
    assert not found.along.any() and not found.across.any()
