"""Flow features against analytic fields."""

import numpy as np
import pytest

from motion_detect_ros.core.background import Background
from motion_detect_ros.core.flow_features import angle, curl, divergence, magnitude, motion_vectors

CELL_PX = (8.0, 4.0)


def points() -> tuple[np.ndarray, np.ndarray]:
    x, y = np.meshgrid(np.arange(12) * CELL_PX[0], np.arange(9) * CELL_PX[1])
    return x.astype(np.float32), y.astype(np.float32)


def test_rotation_has_twice_its_rate_as_curl_and_no_divergence():
    x, y = points()
    rate = 0.03
    flow = np.stack([-rate * y, rate * x], axis=-1)
    np.testing.assert_allclose(curl(flow, CELL_PX), 2 * rate, atol=1e-5)
    np.testing.assert_allclose(divergence(flow, CELL_PX), 0.0, atol=1e-5)


def test_expansion_has_twice_its_rate_as_divergence_and_no_curl():
    x, y = points()
    rate = 0.05
    flow = np.stack([rate * x, rate * y], axis=-1)
    np.testing.assert_allclose(divergence(flow, CELL_PX), 2 * rate, atol=1e-5)
    np.testing.assert_allclose(curl(flow, CELL_PX), 0.0, atol=1e-5)


def test_shear_has_neither_expansion_nor_equal_parts():
    x, y = points()
    flow = np.stack([0.1 * y, np.zeros_like(x)], axis=-1)
    np.testing.assert_allclose(divergence(flow, CELL_PX), 0.0, atol=1e-5)
    np.testing.assert_allclose(curl(flow, CELL_PX), -0.1, atol=1e-5)


@pytest.mark.parametrize(('vector', 'length', 'direction'), [
    ((3.0, 4.0), 5.0, 0.9272952), ((-1.0, 0.0), 1.0, np.pi), ((0.0, -2.0), 2.0, -np.pi / 2)])
def test_magnitude_and_angle(vector, length, direction):
    flow = np.full((2, 3, 2), vector, np.float32)
    np.testing.assert_allclose(magnitude(flow), length, rtol=1e-6)
    np.testing.assert_allclose(angle(flow), direction, rtol=1e-6)


def test_motion_vectors_are_multiples_of_the_local_noise():
    residual = np.array([[[3.0, 1.0], [np.nan, 2.0]]], np.float32)
    background = Background(np.array([[[1.0, 1.0], [0.0, 0.0]]], np.float32), np.array([[0.5, 0.25]], np.float32))
    vectors = motion_vectors(residual, background)
    np.testing.assert_allclose(vectors[0, 0], [4.0, 0.0])
    assert np.isnan(vectors[0, 1, 0])
