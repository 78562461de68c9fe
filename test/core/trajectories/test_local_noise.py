"""The noise around points, against SciPy's interpolation."""

from __future__ import annotations

import cv2
import numpy as np
import pytest
from scipy.ndimage import map_coordinates

from motion_detect_ros.core.trajectories.local_noise import PointGrid

WIDTH, HEIGHT, CELL = 640, 360, 32


@pytest.mark.parametrize('height', [HEIGHT, 20], ids=['image', 'strip of one row of cells'])
def test_local_sigma_is_the_mean_of_the_blurred_cells_between_their_centres(height: int) -> None:
    random = np.random.default_rng(1)
    points = (random.random((500, 2)) * [WIDTH - 1, height - 1]).astype(np.float32)
    lengths, sigma = random.rayleigh(0.5, 500), 0.4
    column, row = (points // CELL).astype(int).T
    sums = np.zeros((2, height // CELL + 1, WIDTH // CELL + 1))
    np.add.at(sums[0], (row, column), np.minimum(lengths, 3.0 * sigma))
    np.add.at(sums[1], (row, column), 1.0)
    total, count = (cv2.GaussianBlur(each, (5, 5), 1.0, borderType=cv2.BORDER_REPLICATE) for each in sums)
    mean = (total + 4.0 * sigma) / (count + 4.0)
    expected = map_coordinates(mean, points.T[::-1].astype(float) / CELL - 0.5, order=1, mode='nearest')
    found = PointGrid(points, WIDTH, height).local_sigma(lengths, sigma)
    np.testing.assert_allclose(found, np.maximum(sigma, expected), atol=1e-5)
    assert (found > sigma).mean() > 0.2


def test_noise_of_one_corner_stays_there() -> None:
    random = np.random.default_rng(2)
    points = (random.random((2000, 2)) * [WIDTH - 1, HEIGHT - 1]).astype(np.float32)
    corner = (points < 100).all(axis=1)
    local = PointGrid(points, WIDTH, HEIGHT).local_sigma(np.where(corner, 0.9, 0.1), 0.3)
    assert local[(points < 40).all(axis=1)].min() > 0.6
    assert (local[(points > 250).any(axis=1)] == 0.3).all()
