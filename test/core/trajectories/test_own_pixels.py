"""Pixels that belong to a cluster's points, against OpenCV's distance transform."""

from __future__ import annotations

import cv2
import numpy as np
import pytest

from motion_detect_ros.core.geometry.boxes import Box
from motion_detect_ros.core.trajectories.own_pixels import NearestPoints

REGION = Box(40, 30, 130, 110)
#: Chamfer distances here are in whole parts of a pixel, OpenCV's are real numbers.
SAME_PX = 2e-3


def distance_to(points: np.ndarray, region: Box = REGION) -> np.ndarray:
    """(h, w) OpenCV's distance of the pixels of the region to the points in it; far without any."""
    columns, rows = np.rint(points).astype(int).T
    inside = (columns >= region.left) & (columns < region.right) & (rows >= region.top) & (rows < region.bottom)
    free = np.ones((region.height, region.width), np.uint8)
    free[rows[inside] - region.top, columns[inside] - region.left] = 0
    return cv2.distanceTransform(free, cv2.DIST_L2, cv2.DIST_MASK_5) if inside.any() else np.full(free.shape, 1e4)


def kept(points: np.ndarray, owner: np.ndarray, number: int, reach_px: float, region: Box = REGION) -> np.ndarray:
    mask = np.ones((region.height, region.width), bool)
    NearestPoints(points, owner).keep_own(mask, region, points[owner == number], number, reach_px)
    return mask


def some_points(seed: int, outside: int = 30) -> tuple[np.ndarray, np.ndarray]:
    """No two in one pixel: clusters 0 and 1 in the region, those of none (-1) and of cluster 2 around it, too."""
    random = np.random.default_rng(seed)
    pixels = random.permutation(150 * 160)[:60 + outside]
    points = np.stack([pixels % 160, pixels // 160], axis=1).astype(np.float32)
    inside = random.permutation(REGION.area)[:60]
    points[:60] = np.stack([REGION.left + inside % REGION.width, REGION.top + inside // REGION.width], axis=1)
    owner = np.r_[np.repeat([0, 1, -1], 20), random.choice([-1, 2], outside)]
    _, first = np.unique(points, axis=0, return_index=True)
    return points[first] + random.uniform(-0.4, 0.4, (len(first), 2)).astype(np.float32), owner[first]


@pytest.mark.parametrize('reach_px', [0.0, 5.0, 9.3, 200.0])
@pytest.mark.parametrize('seed', range(4))
def test_own_pixels_are_near_and_not_nearer_to_another_cluster(seed: int, reach_px: float) -> None:
    points, owner = some_points(seed)
    near, others = distance_to(points[owner == 0]), distance_to(points[owner > 0])
    rest = distance_to(points[owner <= 0])
    expected = (near <= reach_px) & (rest <= others)
    assert 10 < expected.sum() < expected.size
    doubtful = (np.abs(near - reach_px) < SAME_PX) | (np.abs(rest - others) < SAME_PX)
    assert doubtful.mean() < 0.05
    np.testing.assert_array_equal(kept(points, owner, 0, reach_px) | doubtful, expected | doubtful)


def test_pixels_as_near_to_another_cluster_are_kept() -> None:
    points = np.float32([[50, 60], [60, 60]])
    mask = kept(points, np.array([0, 1]), 0, 100.0)
    assert mask[:, :16].all()
    assert not mask[:, 16:].any()


def test_points_of_no_cluster_take_nothing() -> None:
    points = np.float32([[50, 60], [60, 60]])
    assert kept(points, np.array([0, -1]), 0, 200.0).all()
    between = np.float32([[50, 60], [60, 60], [70, 60]])  # but they stand between a cluster and the other one
    assert kept(between, np.array([0, -1, 1]), 0, 200.0)[30].sum() == 26


def test_other_clusters_beyond_the_region_take_nothing() -> None:
    points = np.float32([[41, 60], [39, 60]])
    assert kept(points, np.array([0, 1]), 0, 200.0).all()


def test_what_was_not_foreground_stays_so() -> None:
    mask = np.zeros((REGION.height, REGION.width), bool)
    points = np.float32([[50, 60]])
    NearestPoints(points, np.array([0])).keep_own(mask, REGION, points, 0, 50.0)
    assert not mask.any()


@pytest.mark.parametrize('region', [Box(3, 5, 4, 6), Box(3, 5, 4, 60), Box(0, 5, 90, 6), Box(0, 0, 300, 200)])
def test_regions_of_any_shape(region: Box) -> None:
    points = np.float32([[region.left, region.top], [region.right - 1, region.bottom - 1]])
    near = distance_to(points, region)
    for reach_px in (0.5, 3.1, 40.7):
        assert np.abs(near - reach_px).min() > SAME_PX
        np.testing.assert_array_equal(kept(points, np.zeros(2, int), 0, reach_px, region), near <= reach_px)
