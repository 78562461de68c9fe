"""Against all distances."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.spatial.distance import cdist

from motion_detect_ros.core.geometry.cells import near_others

WIDTH, HEIGHT = 320, 200


@pytest.mark.parametrize('distance_px', [3.0, 20.0, 37.5, 500.0])
def test_near_others(distance_px: float):
    random = np.random.default_rng(0)
    points, others = (random.uniform([0, 0], [WIDTH, HEIGHT], (count, 2)).astype(np.float32) for count in (400, 30))
    expected = (cdist(points, others) < distance_px).any(axis=1)
    assert 0 < expected.sum() <= len(points)
    np.testing.assert_array_equal(near_others(points, others, distance_px, WIDTH, HEIGHT), expected)


def test_at_the_distance_is_not_near():
    points, others = np.array([[30, 10], [29, 10], [10, 30], [319, 199]], np.float32), np.array([[10, 10]], np.float32)
    assert near_others(points, others, 20.0, WIDTH, HEIGHT).tolist() == [False, True, False, False]


def test_without_others_nothing_is_near():
    points = np.array([[30, 10]], np.float32)
    assert not near_others(points, points[:0], 20.0, WIDTH, HEIGHT).any()
    assert len(near_others(points[:0], points, 20.0, WIDTH, HEIGHT)) == 0
