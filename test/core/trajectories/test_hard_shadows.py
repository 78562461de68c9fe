"""Hard shadows of what moves in sunlight: pictures whose objects and shadows are known."""

from __future__ import annotations

import numpy as np
import pytest

from motion_detect_ros.core.detection.candidate import Candidate
from motion_detect_ros.core.pipeline import MotionPipeline
from motion_detect_ros.core.trajectories.hard_shadows import SunSide, dark_side
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


class TestDarkSide:
    def test_below_the_object_is_at_its_bottom(self) -> None:
        assert dark_side(*picture()).tolist() == pytest.approx([0.0, 20 / 50])

    def test_above_it_is_at_its_top(self) -> None:
        assert dark_side(*picture(body=slice(20, 50), dark=slice(0, 20))).tolist() == pytest.approx([0.0, -20 / 50])

    def test_beside_it_is_at_that_side(self) -> None:
        own, ratio = picture()
        assert dark_side(own.T, ratio.T).tolist() == pytest.approx([20 / 50, 0.0])

    def test_windows_are_on_no_side(self) -> None:
        own, ratio = picture(body=slice(0, 50), dark=slice(0, 0))
        ratio[30:36, 20:60] = 0.3
        assert dark_side(own, ratio).tolist() == [0.0, 0.0]

    def test_bright_rims_are_no_part_of_the_object(self) -> None:
        """Where a picture is sharpened, or the ground not met exactly, there is a bright line beside the shadow."""
        own, ratio = picture()
        ratio[57:60, 10:70] = ratio[40:60, 10:13] = ratio[40:60, 67:70] = 1.5
        assert dark_side(own, ratio).tolist() == pytest.approx([0.0, 20 / 50])

    def test_what_is_as_bright_as_the_ground_is_on_no_side(self) -> None:
        assert dark_side(*picture(body=slice(10, 50), dark=slice(0, 0))).tolist() == [0.0, 0.0]

    @pytest.mark.parametrize('grey', [0.3, 1.0])
    def test_nothing_bright_says_nothing(self, grey: float) -> None:
        own, ratio = picture()
        assert dark_side(own, np.full_like(ratio, grey)) is None

    def test_no_pixels_say_nothing(self) -> None:
        own, ratio = picture()
        assert dark_side(np.zeros_like(own), ratio) is None


def sides(*bottom: float) -> list[np.ndarray]:
    return [np.array([0.0, each]) for each in bottom]


class TestSunSide:
    def test_three_quarters_of_the_objects_have_that_share_in_the_dark(self) -> None:
        sun = SunSide()
        sun.add(sides(-0.3, 0.2, 0.3, 0.4, 0.5))
        assert sun.share.tolist() == [0.0, 0.2]

    def test_at_the_top_and_on_the_left_it_is_negative(self) -> None:
        sun = SunSide()
        sun.add([-each[::-1] for each in sides(-0.3, 0.2, 0.3, 0.4, 0.5)])
        assert sun.share.tolist() == [-0.2, 0.0]

    def test_objects_that_differ_have_no_common_side(self) -> None:
        sun = SunSide()
        sun.add(sides(-0.3, -0.2, 0.0, 0.2, 0.3, 0.4))
        assert sun.share.tolist() == [0.0, 0.0]

    def test_few_objects_are_no_scene_however_often_they_are_seen(self) -> None:
        sun = SunSide()
        for _ in range(5):
            sun.add(sides(0.3, 0.3, 0.3, 0.3))
            sun.after(0.1)
        assert not sun.share.any()

    def test_is_forgotten_where_nothing_is_seen_of_it_any_more(self) -> None:
        sun = SunSide()
        sun.add(sides(0.3, 0.3, 0.3, 0.3, 0.3))
        sun.after(1.9)
        sun.add([])
        assert sun.share[1] == pytest.approx(0.3)
        sun.after(0.2)
        sun.add([])
        assert not sun.share.any()

    def test_another_scene_has_its_own(self) -> None:
        sun = SunSide()
        sun.add(sides(0.3, 0.3, 0.3, 0.3, 0.3))
        sun.reset()
        assert not sun.share.any()

    @pytest.mark.parametrize(('share', 'low', 'high'), [
        ((0.0, 0.25), (100.0, 200.0), (140.0, 230.0)), ((-0.25, 0.0), (110.0, 200.0), (140.0, 240.0)),
        ((0.25, -0.5), (100.0, 220.0), (130.0, 240.0)),
    ])
    def test_boxes_lose_that_share_on_that_side(self, share, low, high) -> None:
        sun = SunSide()
        sun.add([np.array(share)] * 5)
        box = Candidate(np.array([120.0, 220.0]), np.array([40.0, 40.0]), np.array([100.0, 0.0]), 900.0, 1.0, 1)
        (found,) = sun.without_shadows([box])
        assert (found.centre - found.size / 2.0).tolist() == pytest.approx(low)
        assert (found.centre + found.size / 2.0).tolist() == pytest.approx(high)
        assert found.velocity_px_s.tolist() == [100.0, 0.0]


def texture(seed: int, height: int, width: int, low: int, high: int) -> np.ndarray:
    """Of 4 x 4 pixels."""
    coarse = np.random.default_rng(seed).integers(low, high, (height // 4 + 1, width // 4 + 1), dtype=np.int64)
    return np.kron(coarse, np.ones((4, 4), np.int64))[:height, :width].astype(np.float64)


def bottoms(darkness: float, places: tuple[tuple[int, int], ...] = PLACES) -> dict[int, float]:
    """How far the boxes of the last frame reach below the object's top, pixels, by its number.

    darkness: share of the light that the shadows leave, all below their objects.
    """
    pipeline, found = MotionPipeline(load_preset('visdrone')), np.empty(0)
    for index in range(FRAMES):
        gray = texture(1, HEIGHT, WIDTH, 90, 130)
        for number, (left, top) in enumerate(places):
            across = slice(left + STEP_PX * index, left + STEP_PX * index + OBJECT_WIDTH)
            gray[top + OBJECT_HEIGHT:top + OBJECT_HEIGHT + SHADOW_HEIGHT, across] *= darkness
            gray[top:top + OBJECT_HEIGHT, across] = texture(
                2 + number, OBJECT_HEIGHT, OBJECT_WIDTH, *((10, 60) if number == BLACK else (150, 255)))
        image = np.repeat(np.rint(gray).astype(np.uint8)[..., None], 3, axis=2)
        found = pipeline.process(image, round((index + 1) * PERIOD_S * 1e9)).detections
        pipeline.wait()
    ends = {}
    for number, (left, top) in enumerate(places):
        middle = left + STEP_PX * (FRAMES - 1) + OBJECT_WIDTH / 2
        own = found[(np.abs(found['u'] - middle) < OBJECT_WIDTH / 2) & (np.abs(found['v'] - top - 25.0) < 25.0)]
        assert len(own) == 1, (number, found)
        ends[number] = float(own['v'][0] + own['height'][0] / 2.0 - top)
    return ends


def test_boxes_in_sunlight_end_near_their_objects_black_ones_too() -> None:
    ends = bottoms(0.3)
    assert max(ends.values()) < OBJECT_HEIGHT + SHADOW_HEIGHT / 2.0
    assert min(ends.values()) > 0.75 * OBJECT_HEIGHT


def test_one_object_alone_keeps_what_may_be_a_part_of_it() -> None:
    """The counterpart of the test above: without it those boxes might be short for another reason."""
    assert min(bottoms(0.3, PLACES[:1]).values()) > OBJECT_HEIGHT + 0.7 * SHADOW_HEIGHT


def test_boxes_without_shadows_lose_nothing() -> None:
    assert min(bottoms(1.0).values()) > OBJECT_HEIGHT - 3.0
