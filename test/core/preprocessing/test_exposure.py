"""Jumps of the exposure against the same pictures without them."""

from __future__ import annotations

from itertools import pairwise

import cv2
import numpy as np
import pytest

from motion_detect_ros.benchmarks.silence import Flight
from motion_detect_ros.core.pipeline import MotionPipeline
from motion_detect_ros.core.preprocessing.exposure import ExposureFollower
from motion_detect_ros.presets import load_preset

HEIGHT, WIDTH, PERIOD_NS = 270, 480, 40_000_000


def scene(seed: int = 0) -> np.ndarray:
    """Grey values from 30 to 200, in spots of all sizes."""
    random = np.random.default_rng(seed)
    layers = [cv2.resize(random.normal(size=(HEIGHT // s + 2, 2 * WIDTH // s + 2)), (2 * WIDTH, HEIGHT),
                         interpolation=cv2.INTER_CUBIC) * s for s in (4, 8, 16, 32)]
    return cv2.normalize(sum(layers), None, 30, 200, cv2.NORM_MINMAX)


def lit(picture: np.ndarray, gain: float) -> np.ndarray:
    return np.clip(np.rint(gain * picture), 0, 255).astype(np.uint8)


def followed(pictures: list[np.ndarray], period_ns: int = PERIOD_NS) -> list[np.ndarray]:
    follower = ExposureFollower()
    return [follower.step(each, (index + 1) * period_ns) for index, each in enumerate(pictures)]


@pytest.mark.parametrize('step_px', [0, 3, 12])
def test_pictures_in_flickering_light_are_as_bright_as_the_first(step_px: int) -> None:
    world, gains = scene(), [1.0, 0.8, 1.2, 1.0, 0.85, 1.15, 0.9]
    views = [world[:, step_px * index:step_px * index + WIDTH] for index in range(len(gains))]
    found = followed([lit(view, gain) for view, gain in zip(views, gains, strict=True)])
    for view, seen, gain in zip(views, found, gains, strict=True):
        assert np.abs(seen - view).mean() < 5.0, f'{gain}, of which 0.8 is 23 grey levels darker'


@pytest.mark.parametrize('gain', [1.0, 0.95, 1.05])
def test_what_trackers_bear_is_left_as_it_is(gain: float) -> None:
    pictures = [lit(scene()[:, :WIDTH], each) for each in (1.0, gain)]
    for picture, seen in zip(pictures, followed(pictures), strict=True):
        assert seen is picture


def test_a_dark_thing_over_four_tenths_of_the_picture_is_no_change_of_the_light() -> None:
    before, after = (lit(scene()[:, :WIDTH], 1.0) for _ in range(2))
    after[:, :WIDTH * 4 // 10] //= 2
    assert followed([before, after])[1] is after


def test_light_that_has_changed_for_good_is_taken_over_within_seconds() -> None:
    pictures = [lit(scene()[:, :WIDTH], gain) for gain in [1.0] + 250 * [0.8]]
    found = followed(pictures)
    assert np.abs(found[1].astype(float) - pictures[0]).mean() < 3.0
    np.testing.assert_array_equal(found[-1], pictures[-1])
    steps = [np.abs(later.astype(float) - earlier).mean() for earlier, later in pairwise(found[1:])]
    assert max(steps) < 1.0, 'without a jump'


def test_what_is_overexposed_stays_white() -> None:
    bright = scene()[:, :WIDTH].copy()
    bright[:60] = 400.0
    found = followed([lit(bright, gain) for gain in (1.0, 1.25)])
    assert (found[1][:60] == 255).all()
    assert np.abs(found[1][80:].astype(float) - found[0][80:]).mean() < 3.0


@pytest.mark.parametrize('case', ['gap', 'backwards', 'size', 'reset'])
def test_the_first_picture_after_a_break_is_as_it_comes(case: str) -> None:
    follower, dark = ExposureFollower(), lit(scene()[:, :WIDTH], 0.7)
    follower.step(lit(scene()[:, :WIDTH], 1.0), 10 * PERIOD_NS)
    if case == 'size':
        dark = dark[:200]
    if case == 'reset':
        follower.reset()
    assert follower.step(dark, {'gap': 100, 'backwards': 9}.get(case, 11) * PERIOD_NS) is dark


@pytest.mark.parametrize('value', [0, 5, 255])
def test_black_and_white_pictures_tell_nothing(value: int) -> None:
    pictures = [np.full((HEIGHT, WIDTH), each, np.uint8) for each in (value, 120, value)]
    for picture, seen in zip(pictures, followed(pictures), strict=True):
        assert seen is picture


def test_cars_are_found_under_a_lamp_that_flickers() -> None:
    """Brightness drawn anew for every picture, by up to a fifth."""
    random, found = np.random.default_rng(3), []
    for share in (0.0, 0.2):
        pipeline, count = MotionPipeline(load_preset('visdrone')), 0
        for frame in Flight('visdrone', {}, 1, 60, WIDTH, HEIGHT, cars=60).pictures():
            image = cv2.convertScaleAbs(frame.image, alpha=1.0 + random.uniform(-share, share))
            count += len(pipeline.process(image, frame.stamp_ns).detections)
        found.append(count)
    assert found[0] > 60
    assert found[1] > 0.6 * found[0], found
