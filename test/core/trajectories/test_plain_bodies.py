"""Plain regions of images, against OpenCV's statistics and a look at every pixel around a point."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import cv2
import numpy as np
import pytest

from motion_detect_ros.core.trajectories.object_motion import PointMotion
from motion_detect_ros.core.trajectories.plain_bodies import PLAIN_GRAY, PlainRegions, _typical, joined_parts

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
    """Labels of the 5 x 5 pixels of the halved image about the one that holds the place's pixel."""
    column, row = np.rint(place).astype(int) // 2
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


#: Nothing is plain but a body: columns 82 to 158 and rows 62 to 78 of the image, a pixel of the half from its edges.
ROOF = np.where(np.indices((70, 120)).sum(axis=0) % 2, 255, 0).astype(np.uint8)
ROOF[30:40, 40:80] = 128


def side(x: float) -> list[tuple[float, float]]:
    return [(x, 64.0), (x, 70.0), (x, 76.0)]


def bodies(
    xs: Sequence[float], ways: Sequence[tuple[float, float]] | None = None, still: Sequence[tuple[float, float]] = (),
    half: np.ndarray = ROOF, largest_px: float = 100.0,
) -> list[list[int]]:
    """What becomes of parts of three points each in columns ``xs``: numbers of those that are joined.

    ways: of each part against the background over half a second, pixels; still: places of points that stand.
    """
    places = np.float32([place for x in xs for place in side(x)])
    way = np.repeat(ways or [(10.0, 0.0)] * len(xs), 3, axis=0).astype(float)
    motion = replace(PointMotion.at_rest(len(places)), displacements=(way,), seconds=(0.48,))
    parts = [np.arange(3 * number, 3 * number + 3) for number in range(len(xs))]
    found = joined_parts(parts, places, np.reshape(np.float32(still), (-1, 2)), motion, half, largest_px)
    assert sorted(np.concatenate(found).tolist()) == list(range(len(places)))
    return [sorted({point // 3 for point in body.tolist()}) for body in found]


def test_both_ends_of_a_plain_body_are_one():
    assert bodies([84.0, 156.0]) == [[0, 1]]
    assert bodies([20.0, 84.0, 156.0]) == [[0], [1, 2]], 'the first one does not touch it'
    assert bodies([84.0, 156.0, 200.0]) == [[0, 1], [2]]
    assert bodies([84.0]) == [[0]]


def test_what_moves_otherwise_does_not_belong_to_the_body_that_it_touches():
    assert bodies([84.0, 156.0], [(10.0, 0.0), (10.0, 20.0)]) == [[0], [1]]
    assert bodies([84.0, 120.0, 156.0], [(10.0, 0.0), (10.0, 20.0), (10.0, 0.0)]) == [[0, 2], [1]]


@pytest.mark.parametrize(('half_way', 'joined'), [(3.0, True), (0.0, False)], ids=['in a bend', 'straight on'])
def test_ends_that_go_apart_are_one_body_where_it_turns_as_its_course_does(half_way: float, joined: bool):
    """Over half a second its ends go 20 px along and 8 px to either side, as 0.22 rad of turn do 36 px from the middle.

    In the bend the middle is 3 px to one side in between, so that the course turns by much more.
    """
    places = np.float32([*side(84.0), *side(153.0), *side(159.0)])
    owner, turned = np.repeat([0, 1], [3, 6]), np.array([-8.0, 8.0])
    ways = (np.stack([np.full(9, 20.0), turned[owner]], axis=1),
            np.stack([np.full(9, 10.0), half_way + turned[owner] / 2.0], axis=1))
    motion = replace(PointMotion.at_rest(9), displacements=ways, seconds=(0.48, 0.24))
    found = joined_parts([np.arange(3), np.arange(3, 9)], places, np.zeros((0, 2), np.float32), motion, ROOF, 100.0)
    assert [each.tolist() for each in found] == ([[*range(9)]] if joined else [[0, 1, 2], [*range(3, 9)]])


@pytest.mark.parametrize('grows', [True, False])
def test_ends_that_go_apart_are_one_body_where_their_points_do_as_well(grows: bool):
    """Each point goes a fifth of its distance from the middle; or the points of an end go as its middle does."""
    places = np.float32([*side(84.0), *side(156.0)])
    offsets = places - [120.0, 70.0]
    if not grows:
        offsets[:, 1] = 0.0
    motion = replace(PointMotion.at_rest(6), displacements=(0.2 * offsets + [20.0, 0.0],), seconds=(0.48,))
    found = joined_parts([np.arange(3), np.arange(3, 6)], places, np.zeros((0, 2), np.float32), motion, ROOF, 100.0)
    assert [each.tolist() for each in found] == ([[*range(6)]] if grows else [[0, 1, 2], [3, 4, 5]])


@pytest.mark.parametrize(('rows', 'joined'), [((30, 42), True), ((30, 43), False), ((28, 40), True), ((26, 40), False)])
def test_a_plain_region_that_goes_on_beside_both_is_ground(rows: tuple[int, int], joined: bool):
    """Points are in rows 64 to 76, so that it may be from 58 to 82."""
    half = ROOF.copy()
    half[slice(*rows), 40:80] = 128
    assert bodies([84.0, 156.0], half=half) == ([[0, 1]] if joined else [[0], [1]])


@pytest.mark.parametrize(('largest_px', 'joined'), [(83.0, True), (81.0, False), (75.0, False)])
def test_parts_farther_apart_than_the_largest_object_are_not_joined(largest_px: float, joined: bool):
    """The region is 76 px long; parts 3 px outside of it, 82 px apart, touch it."""
    assert bodies([79.0, 161.0], largest_px=largest_px) == ([[0, 1]] if joined else [[0], [1]])


@pytest.mark.parametrize(('count', 'joined'), [(3, True), (4, False)])
def test_a_region_with_more_still_points_than_half_of_the_moving_ones_is_part_of_the_scene(count: int, joined: bool):
    still = [(90.0 + 10.0 * number, 70.0) for number in range(count)]
    assert bodies([84.0, 156.0], still=still) == ([[0, 1]] if joined else [[0], [1]])
    away = [(190.0 + number, 70.0) for number in range(8)]
    assert bodies([84.0, 156.0], still=[*still, *away]) == ([[0, 1]] if joined else [[0], [1]])
