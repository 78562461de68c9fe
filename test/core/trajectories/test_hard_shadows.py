"""Hard shadows of what moves in sunlight: pictures whose objects and shadows are known."""

from __future__ import annotations

import numpy as np
import pytest
from warps import blocks

from motion_detect_ros.core.pipeline import MotionPipeline
from motion_detect_ros.core.settings import with_settings
from motion_detect_ros.core.trajectories.hard_shadows import SunSide, dark_side
from motion_detect_ros.core.trajectories.soft_shadows import BRIGHT, DARK, FAINT
from motion_detect_ros.core.types import empty_detections
from motion_detect_ros.presets import load_preset

PERIOD_S, FRAMES = 0.04, 36
HEIGHT, WIDTH = 480, 640
#: Of the objects in the first frame: the left edge and the top; all go to the right by so many pixels a frame.
PLACES = ((30, 40), (300, 90), (60, 160), (280, 230), (40, 300), (260, 370))
OBJECT_WIDTH, OBJECT_HEIGHT, SHADOW_HEIGHT, STEP_PX = 56, 32, 20, 5
#: Number of the object as dark as a shadow.
BLACK = 3


def picture(body: slice = slice(0, 30), dark: slice = slice(30, 50)) -> tuple[np.ndarray, np.ndarray]:
    """The outline of an object of 60 x 50 pixels with its shadow, and its grey values to those of the ground.

    body, dark: rows of the object, twice as bright as the ground, and of the shadow.
    """
    own, ratio = np.zeros((70, 80), bool), np.ones((70, 80), np.float32)
    own[10:60, 10:70] = True
    own[12:58, 12:68] = False
    ratio[10:60, 10:70][body], ratio[10:60, 10:70][dark] = 2.0, 0.3
    return own, ratio


def side(own: np.ndarray, ratio: np.ndarray) -> np.ndarray | None:
    """Of an object some pixels to the right and below the corner of the image."""
    tones = np.zeros((50, 60), np.uint8)
    there = tones[4:4 + ratio.shape[0] // 2, 2:2 + ratio.shape[1] // 2]
    there[:] = np.select([ratio[::2, ::2] > 1.05, ratio[::2, ::2] < 0.74], [BRIGHT, DARK], FAINT)
    return dark_side(own, tones, 4, 8)


class TestDarkSide:
    def test_below_the_object_is_at_its_bottom(self) -> None:
        assert side(*picture()).tolist() == pytest.approx([0.0, 20 / 50])

    def test_above_it_is_at_its_top(self) -> None:
        assert side(*picture(body=slice(20, 50), dark=slice(0, 20))).tolist() == pytest.approx([0.0, -20 / 50])

    def test_beside_it_is_at_that_side(self) -> None:
        own, ratio = picture()
        assert side(own.T, ratio.T).tolist() == pytest.approx([20 / 50, 0.0])

    def test_windows_are_on_no_side(self) -> None:
        own, ratio = picture(body=slice(0, 50), dark=slice(0, 0))
        ratio[30:36, 20:60] = 0.3
        assert side(own, ratio).tolist() == [0.0, 0.0]

    def test_bright_rims_are_no_part_of_the_object(self) -> None:
        """Where a picture is sharpened, or the ground not met exactly, there is a bright line beside the shadow."""
        own, ratio = picture()
        ratio[56:60, 10:70] = ratio[40:60, 10:14] = ratio[40:60, 66:70] = 1.5
        assert side(own, ratio).tolist() == pytest.approx([0.0, 20 / 50])

    def test_what_is_as_bright_as_the_ground_is_on_no_side(self) -> None:
        assert side(*picture(body=slice(10, 50), dark=slice(0, 0))).tolist() == [0.0, 0.0]

    @pytest.mark.parametrize('grey', [0.3, 1.0])
    def test_nothing_bright_says_nothing(self, grey: float) -> None:
        own, ratio = picture()
        assert side(own, np.full_like(ratio, grey)) is None

    def test_no_pixels_say_nothing(self) -> None:
        own, ratio = picture()
        assert side(np.zeros_like(own), ratio) is None


def sides(*bottom: float) -> list[np.ndarray]:
    return [np.array([0.0, each]) for each in bottom]


class TestSunSide:
    def test_three_quarters_of_the_objects_have_that_share_in_the_dark(self) -> None:
        sun = SunSide()
        sun.add(sides(-0.3, 0.2, 0.3, 0.4, 0.5), 0)
        assert sun.share.tolist() == [0.0, 0.2]

    def test_at_the_top_and_on_the_left_it_is_negative(self) -> None:
        sun = SunSide()
        sun.add([-each[::-1] for each in sides(-0.3, 0.2, 0.3, 0.4, 0.5)], 0)
        assert sun.share.tolist() == [-0.2, 0.0]

    def test_objects_that_differ_have_no_common_side(self) -> None:
        sun = SunSide()
        sun.add(sides(-0.3, -0.2, 0.0, 0.2, 0.3, 0.4), 0)
        assert sun.share.tolist() == [0.0, 0.0]

    def test_few_objects_are_no_scene_however_often_they_are_seen(self) -> None:
        sun = SunSide()
        for number in range(5):
            sun.add(sides(0.3, 0.3, 0.3, 0.3), number * 100_000_000)
        assert not sun.share.any()

    def test_one_object_that_is_seen_often_is_no_scene_beside_others_without_shadows(self) -> None:
        sun = SunSide()
        sun.add(sides(0.0, 0.0, 0.0, 0.0, 0.0), 0)
        for number in range(1, 19):
            sun.add(sides(0.4), number * 100_000_000)
        assert not sun.share.any()

    def test_two_thirds_of_a_box_stay_whatever_is_dark(self) -> None:
        sun = SunSide()
        sun.add(sides(0.7, 0.7, 0.7, 0.7, 0.7), 0)
        assert sun.share.tolist() == pytest.approx([0.0, 1.0 / 3.0])

    def test_is_forgotten_where_nothing_is_seen_of_it_any_more(self) -> None:
        sun = SunSide()
        sun.add(sides(0.3, 0.3, 0.3, 0.3, 0.3), 0)
        sun.add([], 1_900_000_000)
        assert sun.share[1] == pytest.approx(0.3)
        sun.add([], 2_100_000_000)
        assert not sun.share.any()

    def test_another_scene_has_its_own(self) -> None:
        sun = SunSide()
        sun.add(sides(0.3, 0.3, 0.3, 0.3, 0.3), 0)
        sun.reset()
        assert not sun.share.any()

    @pytest.mark.parametrize(('share', 'low', 'high', 'area'), [
        ((0.0, 0.25), (100.0, 200.0), (140.0, 230.0), 900.0), ((-0.25, 0.0), (110.0, 200.0), (140.0, 240.0), 900.0),
        ((0.25, -0.3), (100.0, 212.0), (130.0, 240.0), 630.0),
    ])
    def test_boxes_lose_that_share_on_that_side(self, share, low, high, area) -> None:
        (found,) = without(share, (100.0, 200.0), (140.0, 240.0))
        assert (found['u'] - found['width'] / 2.0, found['v'] - found['height'] / 2.0) == pytest.approx(low)
        assert (found['u'] + found['width'] / 2.0, found['v'] + found['height'] / 2.0) == pytest.approx(high)
        assert found['area'] == pytest.approx(area)
        assert found['vel_u'] == 100.0

    @pytest.mark.parametrize(('share', 'low', 'high'), [
        ((0.0, 0.25), (100.0, 440.0), (140.0, 480.0)), ((0.25, 0.0), (600.0, 200.0), (640.0, 240.0)),
        ((0.0, -0.25), (100.0, 0.0), (140.0, 40.0)), ((-0.25, 0.0), (0.0, 200.0), (40.0, 240.0)),
    ])
    def test_nothing_at_the_edge_of_the_image(self, share, low, high) -> None:
        """What reaches beyond it may be the shadow."""
        (found,) = without(share, low, high)
        assert (found['width'], found['height'], found['area']) == (40.0, 40.0, 1200.0)


def without(share: tuple[float, float], low: tuple[float, float], high: tuple[float, float]) -> np.ndarray:
    """A reported box of an image of 640 x 480 without that share."""
    sun, records = SunSide(), empty_detections(1)
    sun.add([np.array(share)] * 5, 0)
    records['u'], records['v'] = (low[0] + high[0]) / 2.0, (low[1] + high[1]) / 2.0
    records['width'], records['height'] = high[0] - low[0], high[1] - low[1]
    records['area'], records['vel_u'] = 1200.0, 100.0
    return sun.without_shadows(records, 640, 480)


class World:
    """Objects with shadows below them that drive to the right, and what a pipeline reports of them."""

    def __init__(self, darkness: float) -> None:
        """darkness: share of the light that the shadows leave."""
        as_it_is = with_settings(load_preset('visdrone'), {'preprocessing.min_width_px': 0})
        self._darkness, self._pipeline = darkness, MotionPipeline(as_it_is)
        self._stamp_s, self._index = 0.0, 0
        self._found = np.empty(0)

    def drive(self, frames: int, places: tuple[tuple[int, int], ...] = PLACES, after_s: float = PERIOD_S) -> None:
        """places: of the objects that there are; after_s: between the last frame and the first one."""
        for number in range(frames):
            self._stamp_s += PERIOD_S if number else after_s
            image = np.repeat(self._picture(places)[..., None], 3, axis=2)
            self._found = self._pipeline.process(image, round(self._stamp_s * 1e9)).detections
            self._pipeline.wait()
            self._index += 1

    def _picture(self, places: tuple[tuple[int, int], ...]) -> np.ndarray:
        gray = blocks(1, HEIGHT, WIDTH, 90, 130)
        for left, top in places:
            number = PLACES.index((left, top))
            across = slice(left + STEP_PX * self._index, left + STEP_PX * self._index + OBJECT_WIDTH)
            gray[top + OBJECT_HEIGHT:top + OBJECT_HEIGHT + SHADOW_HEIGHT, across] *= self._darkness
            gray[top:top + OBJECT_HEIGHT, across] = blocks(
                2 + number, OBJECT_HEIGHT, OBJECT_WIDTH, *((10, 60) if number == BLACK else (150, 255)))
        return np.rint(gray).astype(np.uint8)

    def bottoms(self, places: tuple[tuple[int, int], ...] = PLACES) -> dict[int, float]:
        """How far the boxes of the last frame reach below the object's top, pixels, by its number; of those found."""
        ends = {}
        for left, top in places:
            middle = left + STEP_PX * (self._index - 1) + OBJECT_WIDTH / 2
            own = self._found[(np.abs(self._found['u'] - middle) < OBJECT_WIDTH / 2)
                              & (np.abs(self._found['v'] - top - 25.0) < 25.0)]
            if len(own) == 1:
                ends[PLACES.index((left, top))] = float(own['v'][0] + own['height'][0] / 2.0 - top)
        return ends


WITH_SHADOW = OBJECT_HEIGHT + 0.7 * SHADOW_HEIGHT


def test_boxes_in_sunlight_end_near_their_objects_black_ones_too() -> None:
    world = World(0.3)
    world.drive(FRAMES)
    ends = world.bottoms()
    assert len(ends) >= 5 and BLACK in ends
    assert max(ends.values()) < OBJECT_HEIGHT + SHADOW_HEIGHT / 2.0
    assert min(ends.values()) > 0.75 * OBJECT_HEIGHT


def test_one_object_alone_keeps_what_may_be_a_part_of_it() -> None:
    """The counterpart of the test above: without it those boxes might be short for another reason."""
    world = World(0.3)
    world.drive(FRAMES, PLACES[:1])
    assert world.bottoms()[0] > WITH_SHADOW


def test_boxes_without_shadows_lose_nothing(monkeypatch: pytest.MonkeyPatch) -> None:
    """Against boxes of which nothing is taken: a few pixels of theirs come and go with the points.

    A little later than those with shadows, which set them off from the ground: the last one of five is found after 37
    frames with OpenCV 4.6.
    """
    world = World(1.0)
    world.drive(FRAMES + 4)
    ends = world.bottoms()
    assert len(ends) >= 5
    assert min(ends.values()) > 0.75 * OBJECT_HEIGHT
    monkeypatch.setattr(SunSide, 'without_shadows', lambda _, records, *size: records)
    as_found = World(1.0)
    as_found.drive(FRAMES + 4)
    assert ends == as_found.bottoms()


def test_what_the_others_showed_counts_for_two_seconds() -> None:
    world = World(0.3)
    world.drive(FRAMES)
    world.drive(20, PLACES[:1])
    assert world.bottoms()[0] < OBJECT_HEIGHT + SHADOW_HEIGHT / 2.0
    world.drive(38, PLACES[:1])
    assert world.bottoms()[0] > WITH_SHADOW


def test_after_a_jump_of_time_it_is_another_scene() -> None:
    world = World(0.3)
    world.drive(FRAMES)
    world.drive(12, PLACES[::2], after_s=30.0)
    ends = []
    for _ in range(24):
        world.drive(1, PLACES[::2])
        ends += world.bottoms().values()
    assert len(ends) > 40
    assert np.median(ends) > WITH_SHADOW
