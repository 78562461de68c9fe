"""What holds several objects: points, patches and pictures whose objects are known."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import replace

import numpy as np
import pytest
from point_objects import PointObjects
from still_camera import step
from warps import blocks

from motion_detect_ros.core.detection.patches import Patch, parted_patch
from motion_detect_ros.core.detection.several_objects import UsualSize
from motion_detect_ros.core.geometry.boxes import Box
from motion_detect_ros.core.pipeline import MotionPipeline
from motion_detect_ros.core.trajectories.clusters import MIN_POINTS
from motion_detect_ros.core.trajectories.parted_clusters import parted
from motion_detect_ros.core.types import CameraModel
from motion_detect_ros.presets import load_preset
from motion_detect_ros.sources.synthetic import FlightConfig, ObjectSpec, SyntheticFlight

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

    def test_ends_of_a_plain_body_are_one(self) -> None:
        """Their points are 8 and 12 pixels apart; the side of a car, the root of its area, is 28."""
        assert len(parts_of(self.NEIGHBOURS)) == 2
        assert len(parts_of([self.NEIGHBOURS[0], (124, 124, 40, 20)])) == 1

    def test_few_points_are_one(self) -> None:
        """Every 16 pixels: three points each."""
        assert len(parts_of(self.NEIGHBOURS, spacing=16)) == 1


class TestUsualSize:
    CAR, BUS = CAR_AREA, 3600.0

    def test_one_in_five_does_not_change_it(self) -> None:
        usual = UsualSize(5)
        usual.add([self.BUS, self.CAR, self.CAR, self.CAR, self.CAR], SECOND_NS)
        assert usual.area == pytest.approx(CAR_AREA)

    def test_two_in_five_do(self) -> None:
        usual = UsualSize(5)
        usual.add([self.BUS, self.CAR, self.CAR, self.CAR, self.BUS], SECOND_NS)
        assert usual.area == pytest.approx(self.BUS)

    def test_is_not_known_from_few_objects_seen_again_and_again(self) -> None:
        usual = UsualSize(5)
        for index in range(20):
            usual.add([self.CAR] * 4, SECOND_NS + index)
        assert usual.area is None

    def test_is_remembered_for_two_seconds(self) -> None:
        usual = UsualSize(5)
        usual.add([self.CAR] * 5, SECOND_NS)
        usual.add([], 3 * SECOND_NS)
        assert usual.area == pytest.approx(CAR_AREA)
        usual.add([], 3 * SECOND_NS + 1)
        assert usual.area is None

    def test_is_that_of_the_scene(self) -> None:
        usual = UsualSize(5)
        usual.add([self.CAR] * 5, SECOND_NS)
        usual.reset()
        assert usual.area is None


class TestPatches:
    """The same of pixels: two neighbours, 20 pixels off the corner of the picture."""

    @staticmethod
    def patches(*objects: Rectangle, own: slice = slice(None), near_area: float = math.inf) -> list[Box]:
        """own: columns where the motion is that of the patch."""
        foreground = np.zeros((200, 200), np.bool_)
        for left, top, width, height in objects:
            foreground[top:top + height, left:left + width] = True
        whole = Patch(Box(20, 20, 20 + np.ptp(foreground.any(axis=0).nonzero()) + 1,
                          20 + np.ptp(foreground.any(axis=1).nonzero()) + 1), int(foreground.sum()))
        is_own = np.zeros_like(foreground)
        is_own[:, own] = True
        found = parted_patch(whole, foreground, is_own, CAR_AREA, near_area)
        assert sum(each.pixels for each in found) == pytest.approx(whole.pixels, abs=2)
        return sorted((each.box for each in found), key=lambda box: (box.left, box.top))

    def test_two_of_the_usual_size_side_by_side_are_two(self) -> None:
        """No more than about 600 of 1600 pixels are looked at: edges may be off by two."""
        one, other = self.patches((20, 20, 40, 20), (44, 40, 40, 20))
        assert [one.left, one.top, one.right, one.bottom] == pytest.approx([20, 20, 60, 40], abs=2)
        assert [other.left, other.top, other.right, other.bottom] == pytest.approx([44, 40, 84, 60], abs=2)

    def test_a_large_one_is_one(self) -> None:
        assert self.patches((20, 20, 120, 40)) == [Box(20, 20, 140, 60)]

    def test_a_piece_of_what_moves_another_way_is_no_object(self) -> None:
        """Of the second one's 40 columns 36 and 28 move as the patch does."""
        assert len(self.patches((20, 20, 40, 20), (44, 40, 40, 20), own=slice(0, 80))) == 2
        assert self.patches((20, 20, 40, 20), (44, 40, 40, 20), own=slice(0, 72)) == [Box(20, 20, 84, 60)]

    def test_ends_of_a_plain_body_are_one(self) -> None:
        """6 and 12 columns between them; the side of a car, the root of its area, is 28."""
        assert len(self.patches((20, 20, 40, 20), (66, 30, 40, 20))) == 2
        assert self.patches((20, 20, 40, 20), (72, 30, 40, 20)) == [Box(20, 20, 112, 50)]

    def test_what_is_near_is_one_body(self) -> None:
        assert len(self.patches((20, 20, 40, 20), (44, 40, 40, 20), near_area=64.0 * 40.0 + 1.0)) == 2
        assert self.patches((20, 20, 40, 20), (44, 40, 40, 20), near_area=64.0 * 40.0) == [Box(20, 20, 84, 60)]


class TestPictures:
    """Cars of 40 x 24 pixels that go to the right for 60 frames, 25 a second, over still ground."""

    HEIGHT, WIDTH, PERIOD_NS = 300, 960, SECOND_NS // 25
    CAMERA = CameraModel(WIDTH, HEIGHT, 640.0, 640.0, WIDTH / 2.0, HEIGHT / 2.0)
    ALONE: Sequence[Rectangle] = (
        (40, 20, 40, 24), (200, 30, 40, 24), (340, 25, 40, 24), (40, 250, 40, 24), (300, 255, 40, 24))
    #: Their pictures touch along 4 pixels.
    PAIR: Sequence[Rectangle] = ((150, 120, 40, 24), (186, 144, 40, 24))

    def pictures(self, objects: Sequence[Rectangle], speed: int, plain: slice) -> Iterator[np.ndarray]:
        ground = blocks(1, self.HEIGHT, self.WIDTH, 80, 120)
        looks = [blocks(2 + number, height, width, 160, 255) for number, (_, _, width, height) in enumerate(objects)]
        looks[-1][:, plain] = 215
        for index in range(60):
            gray = ground.copy()
            for look, (left, top, width, height) in zip(looks, objects, strict=True):
                there = left + speed * index
                gray[top:top + height, there:there + width] = look[:, :max(0, self.WIDTH - there)]
            yield np.clip(np.rint(gray), 0, 255).astype(np.uint8)

    def found(
        self, objects: Sequence[Rectangle], by: PointObjects | None = None, speed: int = 2, plain: slice = slice(0),
    ) -> list[list[float]]:
        """Left, top, right and bottom of what is found last around ``PAIR``.

        speed: pixels a frame; plain: columns of the last object without texture.
        """
        finder, last = by or PointObjects(load_preset('visdrone')), list[list[float]]()
        for index, picture in enumerate(self.pictures(objects, speed, plain)):
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

    def test_a_bus_whose_roof_is_plain_is_one(self) -> None:
        """What is between its ends changed all the same, at this speed."""
        found = self.found([*self.ALONE, (100, 120, 110, 26)], speed=6, plain=slice(35, 75))
        assert found == [pytest.approx([454, 120, 564, 146], abs=8.0)]

    def test_another_scene_has_its_own_sizes(self) -> None:
        finder = PointObjects(load_preset('visdrone'))
        assert len(self.found([*self.ALONE, *self.PAIR], finder)) == 2
        finder.reset()
        assert len(self.found(self.PAIR, finder)) == 1


def shown_by_flow(others: int, pair_size: float = 1.0, by: MotionPipeline | None = None) -> int:
    """How many boxes the preset ``default`` reports last in the middle of a flight over boxes of about 80 x 33 pixels:
    two that touch along a quarter of their length, and up to ten others of their speed around them.

    pair_size: of the two, in sizes of the others.
    """
    pair = [(pair_size, pair_size * x, pair_size * y) for x, y in ((-0.8, 0.9), (2.5, -0.95))]
    around = [(1.0, x, y) for x in (0.0, -8.0, 8.0, -16.0, 16.0) for y in (9.0, -9.0)][:others]
    boxes = tuple(ObjectSpec('box', x - 6.0, y, 0.0, 6.0, 4.4 * size, 1.8 * size, 1.0)
                  for size, x, y in (*pair, *around))
    flight = SyntheticFlight(replace(
        FlightConfig.approach(0.0, frames=41), width=960, height=540, altitude_m=40.0, objects=boxes))
    pipeline = by or MotionPipeline()
    for frame in flight:
        last = pipeline.process(frame.image, frame.stamp_ns).detections
    return int((np.abs(last['v'] - 270.0) < 90.0).sum())


def test_a_pair_that_flow_shows_among_others_is_two() -> None:
    assert shown_by_flow(10) == 2


@pytest.mark.parametrize('others', [0, 6])
def test_a_pair_that_flow_shows_among_few_is_one(others: int) -> None:
    """Few candidates may be the pieces of one body."""
    assert shown_by_flow(others) == 1


def test_a_large_pair_among_others_is_one() -> None:
    """Its box is 0.06 of the picture: what is so near may be limbs."""
    assert shown_by_flow(10, 1.7) == 1


def test_flow_of_another_scene_has_its_own_sizes() -> None:
    pipeline = MotionPipeline()
    assert shown_by_flow(10, by=pipeline) == 2
    pipeline.reset()
    assert shown_by_flow(0, by=pipeline) == 1
