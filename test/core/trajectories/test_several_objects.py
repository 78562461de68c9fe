"""Clusters that hold several objects: points and pictures whose objects are known."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import pytest
from still_camera import step
from warps import blocks

from motion_detect_ros.core.trajectories.clusters import MIN_POINTS
from motion_detect_ros.core.trajectories.finder import TrajectoryFinder
from motion_detect_ros.core.trajectories.several_objects import UsualSize, parted
from motion_detect_ros.core.types import CameraModel
from motion_detect_ros.presets import load_preset

SECOND_NS = 1_000_000_000
#: Left, top, width, height.
Rectangle = tuple[int, int, int, int]
#: A car of 40 x 20 pixels, as its points and what they see around them show it.
CAR_AREA = 800.0


def grid(left: int, top: int, width: int, height: int, spacing: int = 4) -> np.ndarray:
    """Points of an object, ``spacing`` pixels apart, which see 4 pixels beyond themselves."""
    columns, rows = np.arange(left + 4, left + width - 3, spacing), np.arange(top + 4, top + height - 3, spacing)
    return np.stack(np.meshgrid(columns, rows), -1).reshape(-1, 2).astype(np.float32)


def parts_of(
    objects: Sequence[Rectangle], usual_area: float | None = CAR_AREA, growth: float = 0.0, spacing: int = 4,
) -> list[set[int]]:
    """Of one cluster of the points of all objects: which objects each part has points of.

    growth: what a pixel to the right adds to the way of 60 pixels, pixels.
    """
    groups = [grid(*each, spacing=spacing) for each in objects]
    places = np.concatenate(groups)
    owner = np.repeat(np.arange(len(groups)), [len(group) for group in groups])
    way = np.stack([60.0 + growth * places[:, 0], np.zeros(len(places))], axis=1)
    found = parted(np.arange(len(places)), places, [np.full_like(way, np.nan), way], usual_area, MIN_POINTS)
    assert sorted(np.concatenate(found).tolist()) == list(range(len(places)))
    return [set(owner[part].tolist()) for part in found]


class TestParted:
    NEIGHBOURS: Sequence[Rectangle] = ((100, 100, 40, 20), (124, 120, 40, 20))

    def test_two_of_the_usual_size_side_by_side_are_two(self) -> None:
        assert parts_of(self.NEIGHBOURS) in ([{0}, {1}], [{1}, {0}])

    def test_a_row_of_three_are_three(self) -> None:
        row = (*self.NEIGHBOURS, (148, 140, 40, 20))
        assert sorted(map(sorted, parts_of(row))) == [[0], [1], [2]]

    def test_where_others_are_as_large_it_is_one(self) -> None:
        """Its box has 64 x 40 = 2560 pixels."""
        assert len(parts_of(self.NEIGHBOURS, usual_area=1700.0)) == 1

    def test_as_long_as_the_usual_size_is_not_known_it_is_one(self) -> None:
        assert len(parts_of(self.NEIGHBOURS, usual_area=None)) == 1

    def test_what_fills_its_box_is_one_however_large(self) -> None:
        """A bus among cars."""
        assert len(parts_of([(100, 100, 120, 30)])) == 1

    def test_a_long_one_is_one_in_any_direction(self) -> None:
        """A bus of 120 x 30 pixels turned by 45 degrees leaves half of its box empty."""
        bus = grid(0, 0, 120, 30) @ np.float32([[0.7071, 0.7071], [-0.7071, 0.7071]])
        every = np.arange(len(bus))
        assert parted(every, bus, [np.full(bus.shape, 60.0)], CAR_AREA, MIN_POINTS)[0].tolist() == every.tolist()

    def test_what_grows_all_over_is_one(self) -> None:
        """A vehicle that comes closer: its halves' middles are 24 pixels apart, so their ways differ by 24 or 2 of
        about 150 or 70 pixels.
        """
        assert len(parts_of(self.NEIGHBOURS, growth=1.0)) == 1
        assert len(parts_of(self.NEIGHBOURS, growth=0.1)) == 2

    def test_few_points_are_one(self) -> None:
        """Every 16 pixels: three points each."""
        assert len(parts_of(self.NEIGHBOURS, spacing=16)) == 1


class TestUsualSize:
    CAR = np.array([100.0, 100.0]), np.array([132.0, 112.0])
    BUS = np.array([100.0, 200.0]), np.array([212.0, 222.0])

    def test_one_in_five_does_not_change_it(self) -> None:
        usual = UsualSize()
        usual.add([self.BUS, self.CAR, self.CAR, self.CAR, self.CAR], SECOND_NS)
        assert usual.area == pytest.approx(CAR_AREA)

    def test_two_in_five_do(self) -> None:
        usual = UsualSize()
        usual.add([self.BUS, self.CAR, self.CAR, self.CAR, self.BUS], SECOND_NS)
        assert usual.area == pytest.approx(120 * 30)

    def test_is_not_known_from_few_objects_seen_again_and_again(self) -> None:
        usual = UsualSize()
        for index in range(20):
            usual.add([self.CAR] * 4, SECOND_NS + index)
        assert usual.area is None

    def test_is_remembered_for_two_seconds(self) -> None:
        usual = UsualSize()
        usual.add([self.CAR] * 5, SECOND_NS)
        usual.add([], 3 * SECOND_NS)
        assert usual.area == pytest.approx(CAR_AREA)
        usual.add([], 3 * SECOND_NS + 1)
        assert usual.area is None

    def test_is_that_of_the_scene(self) -> None:
        usual = UsualSize()
        usual.add([self.CAR] * 5, SECOND_NS)
        usual.reset()
        assert usual.area is None


class TestFinder:
    """Cars of 40 x 24 pixels that go to the right by 2 pixels a frame for 60 frames, 25 a second, over still ground."""

    HEIGHT, WIDTH, PERIOD_NS = 300, 640, SECOND_NS // 25
    CAMERA = CameraModel(WIDTH, HEIGHT, 640.0, 640.0, WIDTH / 2.0, HEIGHT / 2.0)
    ALONE: Sequence[Rectangle] = (
        (40, 20, 40, 24), (200, 30, 40, 24), (340, 25, 40, 24), (40, 250, 40, 24), (300, 255, 40, 24))
    #: Their pictures touch along 4 pixels.
    PAIR: Sequence[Rectangle] = ((150, 120, 40, 24), (186, 144, 40, 24))

    def found(self, objects: Sequence[Rectangle]) -> list[list[float]]:
        """Left, top, right and bottom of what is found last around ``PAIR``."""
        ground = blocks(1, self.HEIGHT, self.WIDTH, 80, 120)
        finder, last = TrajectoryFinder(load_preset('visdrone')), list[list[float]]()
        for index in range(60):
            gray = ground.copy()
            for number, (left, top, width, height) in enumerate(objects):
                there = left + 2 * index
                gray[top:top + height, there:there + width] = blocks(2 + number, height, width, 160, 255)
            picture = np.clip(np.rint(gray), 0, 255).astype(np.uint8)
            candidates = finder.candidates(*step(picture, index, self.PERIOD_NS), self.CAMERA)
            last = [[*(each.centre - each.size / 2.0), *(each.centre + each.size / 2.0)] for each in candidates]
        return sorted(box for box in last if 100.0 < box[1] < 160.0)

    def test_a_pair_among_cars_is_two(self) -> None:
        """Points see 4 pixels beyond an object, into its neighbour as well."""
        one, other = self.found([*self.ALONE, *self.PAIR])
        assert one == pytest.approx([268, 120, 308, 144], abs=8.0)
        assert other == pytest.approx([304, 144, 344, 168], abs=8.0)

    def test_alone_it_may_be_a_lorry(self) -> None:
        assert self.found(self.PAIR) == [pytest.approx([268, 120, 344, 168], abs=8.0)]
