"""Against all distances."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.spatial.distance import cdist

from motion_detect_ros.core.geometry.cells import first_of_cells, near_others

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


@pytest.mark.parametrize('cell_px', [2.0, 16.0, 500.0])
def test_the_first_of_a_cell_in_an_order(cell_px: float):
    random = np.random.default_rng(1)
    points = random.uniform([0, 0], [WIDTH, HEIGHT], (300, 2)).astype(np.float32)
    order = random.permutation(300)[:200]
    first = dict[tuple[int, ...], int]()
    for index in order.tolist():
        first.setdefault(tuple((points[index] // cell_px).astype(int)), index)
    assert first_of_cells(points, cell_px, WIDTH, HEIGHT, order).tolist() == sorted(first.values())
