"""Regions of change, and what they tell of the boxes of points: pictures whose objects are known."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
import pytest
from point_objects import PointObjects
from still_camera import frames_of, step
from warps import blocks

from motion_detect_ros.core.trajectories.changed_regions import ChangedRegions
from motion_detect_ros.core.trajectories.clusters import Cluster
from motion_detect_ros.core.trajectories.found_objects import ClusteredPoints, FoundObject, objects_of
from motion_detect_ros.core.trajectories.point_scoring import PointScore
from motion_detect_ros.core.trajectories.points import Points
from motion_detect_ros.core.trajectories.recent_frames import MAX_FRAMES, RecentFrames
from motion_detect_ros.core.trajectories.soft_shadows import SoftShadows
from motion_detect_ros.core.types import CameraModel
from motion_detect_ros.presets import load_preset

PERIOD_NS, FRAMES = 40_000_000, 26
HEIGHT, WIDTH = 240, 480
CAMERA = CameraModel(WIDTH, HEIGHT, 480.0, 480.0, WIDTH / 2.0, HEIGHT / 2.0)
GROUND = blocks(1, HEIGHT, WIDTH, 80, 120)
#: Left, top, width, height of an object in the last frame.
Rectangle = tuple[int, int, int, int]


def picture(objects: dict[Rectangle, float], ago: int) -> np.ndarray:
    """The ground with objects that move to the right, each by its own pixels a frame."""
    gray = GROUND.copy()
    for (left, top, width, height), speed in objects.items():
        there = left - round(speed * ago)
        gray[top:top + height, there:there + width] = blocks(2, height, width, 160, 255)
    return np.clip(np.rint(gray), 0, 255).astype(np.uint8)


def history(objects: dict[Rectangle, float], count: int = FRAMES) -> RecentFrames:
    return frames_of((picture(objects, ago) for ago in range(count - 1, -1, -1)), PERIOD_NS)


def boxes(regions: ChangedRegions) -> list[list[float]]:
    return np.concatenate([regions.low, regions.high], axis=1).tolist()


class TestRegions:
    def test_what_has_gone_its_length_is_a_region(self) -> None:
        regions = ChangedRegions.of(history({(300, 100, 40, 24): 4.0}), None)
        assert boxes(regions) == [pytest.approx([300, 100, 340, 124], abs=2.0)]
        assert regions.fill[0] > 0.9

    def test_the_place_that_it_left_is_none(self) -> None:
        """Half a second ago it was at 250, a second ago at 200: the ground there is as it was at one of the times."""
        (left,) = ChangedRegions.of(history({(300, 100, 40, 24): 4.0}), None).low[:, 0]
        assert left > 290.0

    def test_what_stands_is_none(self) -> None:
        assert not len(ChangedRegions.of(history({(300, 100, 40, 24): 0.0}), None).low)

    def test_ground_that_is_a_pixel_off_is_none_and_three_pixels_off_it_is(self) -> None:
        still = np.clip(np.rint(GROUND), 0, 255).astype(np.uint8)
        for shift, is_changed in ((1, False), (3, True)):
            frames = frames_of([np.roll(still, shift, axis=1)] * (FRAMES - 1) + [still], PERIOD_NS)
            count = len(ChangedRegions.of(frames, None).low)
            assert (count > 20) == is_changed, shift
            assert is_changed or count <= 2

    def test_two_times_must_be_known(self) -> None:
        """Of 0.4 s both earlier frames are the oldest one: what it shows may have gone, or come."""
        moving = {(300, 100, 40, 24): 4.0}
        assert not len(ChangedRegions.of(history(moving, count=11), None).low)
        assert len(ChangedRegions.of(history(moving, count=21), None).low)

    def test_what_is_not_the_scene_is_none(self) -> None:
        mask = np.ones((HEIGHT, WIDTH), bool)
        mask[:, 320:] = False
        regions = ChangedRegions.of(history({(300, 100, 40, 24): 4.0}), mask)
        assert boxes(regions) == [pytest.approx([300, 100, 320, 124], abs=2.0)]

    def test_pictures_of_odd_sizes(self) -> None:
        """Half of 241 x 481 pixels is 121 x 241: the mask is halved the same way."""
        frames = frames_of([np.full((241, 481), 90, np.uint8)] * FRAMES, PERIOD_NS)
        assert not len(ChangedRegions.of(frames, np.ones((241, 481), bool)).low)


def regions_of(*of: tuple[float, float, float, float, float]) -> ChangedRegions:
    """Left, top, right, bottom, fill of each."""
    table = np.array(of, np.float64).reshape(-1, 5)
    return ChangedRegions(table[:, :2], table[:, 2:4], table[:, 4], 0.5)


def edges(*of: tuple[float, float, float, float]) -> tuple[np.ndarray, np.ndarray]:
    table = np.array(of, np.float64).reshape(-1, 4)
    return table[:, :2], table[:, 2:]


class TestMostAlike:
    def test_is_the_one_with_the_largest_intersection_over_union(self) -> None:
        regions = regions_of((0, 0, 10, 10, 1), (20, 0, 30, 10, 1))
        best, iou = regions.most_alike(*edges((22, 0, 32, 10), (0, 0, 5, 10), (50, 50, 60, 60)))
        assert best[:2].tolist() == [1, 0]
        assert iou == pytest.approx([8 / 12, 0.5, 0.0])

    def test_without_any_region_it_is_0(self) -> None:
        _, iou = regions_of().most_alike(*edges((0, 0, 10, 10)))
        assert iou.tolist() == [0.0]


class TestTail:
    """Of an object that moves to the right, by 100 or 20 pixels in the half second of ``regions_of``."""

    @pytest.mark.parametrize(
        ('length', 'speed', 'tail'), [(100, 100.0, 50), (60, 100.0, 10), (40, 100.0, 0), (40, 20.0, 10)])
    def test_of_a_known_region_is_cut_off(self, length: int, speed: float, tail: int) -> None:
        """The ground from where the object was half a second ago to where it was, at its front, a second ago."""
        object_low, object_high = edges((200, 60, 200 + length, 100))
        region = regions_of((200 - tail, 60, 200 + length, 100, 1))
        low, high = region.without_tail(0, object_low[0], object_high[0], np.array([speed, 0.0]))
        assert [*low, *high] == [200, 60, 200 + length, 100]

    def test_of_a_real_one_too(self) -> None:
        for left, speed in ((200, 4.0), (280, -4.0)):
            regions = ChangedRegions.of(history({(left, 60, 100, 40): speed}), None)
            low, high = edges((left, 60, left + 100, 100))
            (region,), _ = regions.most_alike(low, high)
            assert regions.high[region, 0] - regions.low[region, 0] > 140.0
            low, high = regions.without_tail(region, low[0], high[0], np.array([25.0 * speed, 0.0]))
            assert [*low, *high] == pytest.approx([left, 60, left + 100, 100], abs=4.0)

    def test_edges_within_the_object_stay(self) -> None:
        """A region that shows its front part only."""
        low, high = regions_of((230, 60, 300, 100, 1)).without_tail(
            0, np.array([200.0, 60.0]), np.array([300.0, 100.0]), np.array([100.0, 0.0]))
        assert [*low, *high] == [230, 60, 300, 100]


class TestBodies:
    PARTS = (0.0, 0.0, 30.0, 40.0), (20.0, 10.0, 60.0, 40.0)

    def bodies(self, fill: float, *parts: tuple[float, float, float, float]) -> list[tuple[int, list[int]]]:
        found = regions_of((0, 0, 60, 40, fill)).bodies(*edges(*parts))
        return [(region, there.tolist()) for region, there in found]

    def test_overlapping_boxes_in_a_compact_region_are_parts_of_one(self) -> None:
        assert self.bodies(0.8, *self.PARTS) == [(0, [0, 1])]

    def test_a_third_one_belongs_to_them_wherever_it_is_in_the_region(self) -> None:
        assert self.bodies(0.8, *self.PARTS, (50.0, 0.0, 58.0, 8.0)) == [(0, [0, 1, 2])]

    def test_boxes_side_by_side_are_neighbours(self) -> None:
        assert self.bodies(0.8, (0.0, 0.0, 28.0, 40.0), (32.0, 0.0, 60.0, 40.0)) == []

    def test_a_region_that_is_not_compact_is_several(self) -> None:
        assert self.bodies(0.5, *self.PARTS) == []

    def test_a_box_that_is_half_outside_is_no_part(self) -> None:
        assert self.bodies(0.8, self.PARTS[0], (20.0, 10.0, 100.0, 40.0)) == []

    def test_one_box_is_no_parts(self) -> None:
        assert self.bodies(0.8, self.PARTS[0]) == []

    def test_a_part_belongs_to_one_body_only(self) -> None:
        twice = regions_of((0, 0, 60, 40, 0.8), (0, 0, 61, 41, 0.8)).bodies(*edges(*self.PARTS))
        assert len(twice) == 1


def objects_with(
    groups: Sequence[tuple[Rectangle, float]], body: Rectangle, score: PointScore, max_area_share: float = 0.5,
    usual_area: float | None = None,
) -> list[FoundObject]:
    """Of a body that moves by 4 pixels a frame, whose points are in clusters: where, and pixels a second apart."""
    frames = history({body: 4.0})
    clusters, places = list[Cluster](), list[np.ndarray]()
    for (left, top, width, height), apart in groups:
        rows, columns = np.arange(top + 3, top + height, 8), np.arange(left + 3, left + width, 8)
        there = np.stack(np.meshgrid(columns, rows), -1).reshape(-1, 2).astype(np.float32)
        first = sum(len(each) for each in places)
        clusters.append(Cluster(np.arange(first, first + len(there)), there.min(axis=0), there.max(axis=0),
                                np.array([100.0 + apart, 0.0]), np.zeros(2)))
        places.append(there)
    now = np.concatenate(places)
    path = (now[:, None] - np.outer(np.arange(MAX_FRAMES), [4.0, 0.0])).astype(np.float32)
    points = Points(path, np.full(len(now), FRAMES - 1, np.int32), np.zeros((len(now), 2), np.float32),
                    np.arange(len(now)))
    every = np.arange(len(now))
    of = ClusteredPoints(clusters, points, every, every, usual_area=usual_area)
    return objects_of(of, frames, None, SoftShadows(frames),
                      replace(load_preset('visdrone').objects, max_area_share=max_area_share), score)


class TestObjects:
    BODY = (200, 60, 100, 60)
    PARTS = (((200, 60, 60, 60), 0.0), ((250, 60, 50, 60), 5.0))

    def test_parts_of_a_body_that_moved_differently_are_one_object(self) -> None:
        (found,) = objects_with(self.PARTS, self.BODY, PointScore())
        assert [*found.box.low, *found.box.high] == pytest.approx([200, 60, 300, 120], abs=6.0)
        assert len(found.cluster.members) == found.figures.points == 64 + 48

    def test_parts_stay_where_the_whole_is_not_believed(self) -> None:
        """More points count against an object, and none has over 70 of them."""
        against = replace(PointScore(), intercept=14.0, per_log_points=-5.0)
        assert len(objects_with(self.PARTS, self.BODY, against)) == 2

    def test_parts_stay_where_the_whole_is_larger_than_allowed(self) -> None:
        """The body is 0.052 of the picture, its parts are 0.031 and 0.026."""
        assert len(objects_with(self.PARTS, self.BODY, PointScore(), max_area_share=0.045)) == 2

    def test_parts_stay_where_the_whole_is_too_large_for_one_object_of_the_scene(self) -> None:
        """Two that overlap at a corner, in one region of 100 x 70 pixels."""
        pair, body = (((200, 60, 60, 40), 0.0), ((240, 90, 60, 40), 5.0)), (200, 60, 100, 70)
        assert len(objects_with(pair, body, PointScore())) == 1
        assert len(objects_with(pair, body, PointScore(), usual_area=2400.0)) == 2


def test_a_small_box_ends_where_its_object_does() -> None:
    """Of 12 x 16 pixels; without regions of change its box is 5 pixels too wide."""
    finder, widths = PointObjects(load_preset('visdrone')), list[float]()
    for index in range(60):
        objects = {(120 + 2 * index, 60 + 40 * row, 12, 16): 0.0 for row in range(4)}
        found = finder.candidates(*step(picture(objects, 0), index, PERIOD_NS), CAMERA)
        if index >= 30 and finder.finder.found:
            widths += [one.size[0] for one in found if one.size[0] < 24.0]
    assert len(widths) >= 20
    assert np.median(widths) == pytest.approx(12.0, abs=3.5)
