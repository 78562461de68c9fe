"""Plain regions of images, against OpenCV's statistics and a look at every pixel around a point."""

from __future__ import annotations

import cv2
import numpy as np
import pytest

from motion_detect_ros.core.trajectories.plain_bodies import PLAIN_GRAY, PlainRegions, _typical

HALF = cv2.resize(np.random.default_rng(0).integers(0, 4, (27, 48)).astype(np.uint8) * 40, None, fx=5, fy=5,
                  interpolation=cv2.INTER_NEAREST)
HEIGHT, WIDTH = 2 * HALF.shape[0], 2 * HALF.shape[1]
LARGEST_PX = 40.0
PLACES = np.concatenate([
    np.random.default_rng(1).uniform([0, 0], [WIDTH - 1, HEIGHT - 1], (300, 2)),
    [[0, 0], [WIDTH - 1, HEIGHT - 1], [WIDTH - 1, 0], [3, 5], [7, 9]],
]).astype(np.float32)


def components() -> tuple[np.ndarray, np.ndarray]:
    """(h, w) labels and (regions, 4) left, top, right, bottom in pixels of the image, high ones exclusive."""
    window = np.ones((3, 3), np.uint8)
    plain = (cv2.dilate(HALF, window).astype(int) - cv2.erode(HALF, window) < PLAIN_GRAY).astype(np.uint8)
    _, labels, stats, _ = cv2.connectedComponentsWithStats(plain, connectivity=4)
    left, top, width, height, _ = stats.T
    return labels, 2.0 * np.stack([left, top, left + width, top + height], axis=1)


LABELS, BOUNDS = components()
SMALL = (BOUNDS[:, 2:] - BOUNDS[:, :2]).max(axis=1) <= LARGEST_PX
SMALL[0] = False


def around(place: np.ndarray) -> set[int]:
    """Labels of the 5 x 5 pixels of the halved image."""
    column, row = np.rint(place / 2.0).astype(int)
    return {int(LABELS[min(max(row + down, 0), LABELS.shape[0] - 1), min(max(column + right, 0), LABELS.shape[1] - 1)])
            for down in range(-2, 3) for right in range(-2, 3)}


def test_there_are_regions_of_both_kinds():
    """Else the next tests would hold nothing."""
    assert SMALL.sum() > 50
    assert (~SMALL[1:]).sum() > 3


def test_each_point_touches_the_small_regions_around_it_once():
    found = PlainRegions(HALF, LARGEST_PX).touched(PLACES).tolist()
    expected = [[point, label] for point, place in enumerate(PLACES) for label in sorted(around(place)) if SMALL[label]]
    assert sorted(found) == expected


@pytest.mark.parametrize('region', np.flatnonzero(SMALL)[::9].tolist())
def test_points_that_touch_a_region_are_counted(region: int):
    regions = PlainRegions(HALF, LARGEST_PX)
    expected = sum(region in around(place) for place in PLACES)
    assert regions.touching(region, PLACES) == expected


def test_the_displacement_of_a_part_is_the_median_of_its_points_that_are_old_enough():
    """At least half of them must be."""
    random = np.random.default_rng(4)
    ways = [random.normal(size=(40, 2)) for _ in range(2)]
    ways[0][[0, 1, 10, 11, 12]] = np.nan
    ways[1][:] = np.nan
    parts = [np.arange(4), np.arange(4, 9), np.arange(10, 15), np.array([39, 20, 30])]
    old, unknown = _typical(ways, parts, np.array([0, 2, 3]))
    np.testing.assert_allclose(old[0], np.median(ways[0][2:4], axis=0))
    np.testing.assert_allclose(old[3], np.median(ways[0][[20, 30, 39]], axis=0))
    assert np.isnan(old[1:3]).all(), 'one is not used, of the other two of five points are old'
    assert np.isnan(unknown).all()
    assert all(np.isnan(each).all() for each in _typical(ways, parts, np.zeros(0, np.intp)))


@pytest.mark.parametrize(('beyond_px', 'is_within'), [(6.0, True), (6.5, False)])
@pytest.mark.parametrize('side', range(4))
def test_a_region_within_bounds_reaches_six_pixels_beyond_them(beyond_px: float, is_within: bool, side: int):
    regions, numbers = PlainRegions(HALF, LARGEST_PX), np.flatnonzero(SMALL)
    bounds = BOUNDS[numbers].copy()
    bounds[:, side] += beyond_px if side < 2 else -beyond_px
    assert (regions.within(numbers, bounds[:, :2], bounds[:, 2:]) == is_within).all()
