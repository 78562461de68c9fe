"""Jumps of the exposure and dull pictures, against the same pictures without them."""

from __future__ import annotations

from itertools import pairwise

import cv2
import numpy as np
import pytest

from motion_detect_ros.benchmarks.silence import Flight
from motion_detect_ros.core.pipeline import MotionPipeline
from motion_detect_ros.core.preprocessing.brightness import Brightness
from motion_detect_ros.presets import load_preset

HEIGHT, WIDTH, PERIOD_NS = 270, 480, 40_000_000


def scene(seed: int = 0) -> np.ndarray:
    """Grey values from 30 to 200, half of them under 85, in spots of all sizes."""
    random = np.random.default_rng(seed)
    layers = [cv2.resize(random.normal(size=(HEIGHT // s + 2, 2 * WIDTH // s + 2)), (2 * WIDTH, HEIGHT),
                         interpolation=cv2.INTER_CUBIC) * s for s in (4, 8, 16, 32)]
    ranks = np.argsort(np.argsort(sum(layers), axis=None)) / (2 * WIDTH * HEIGHT - 1)
    return (30.0 + 170.0 * ranks.reshape(HEIGHT, 2 * WIDTH) ** 1.6).astype(float)


def lit(picture: np.ndarray, gain: float) -> np.ndarray:
    return np.clip(np.rint(gain * picture), 0, 255).astype(np.uint8)


def followed(pictures: list[np.ndarray], period_ns: int = PERIOD_NS) -> list[np.ndarray]:
    brightness = Brightness()
    return [brightness.step(each, (index + 1) * period_ns) for index, each in enumerate(pictures)]


@pytest.mark.parametrize('step_px', [0, 3, 6])
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
    brightness, dark = Brightness(), lit(scene()[:, :WIDTH], 0.7)
    brightness.step(lit(scene()[:, :WIDTH], 1.0), 10 * PERIOD_NS)
    if case == 'size':
        dark = dark[:200]
    if case == 'reset':
        brightness.reset()
    assert brightness.step(dark, {'gap': 100, 'backwards': 9}.get(case, 11) * PERIOD_NS) is dark


@pytest.mark.parametrize('value', [0, 5, 255])
def test_black_and_white_pictures_tell_nothing(value: int) -> None:
    pictures = [np.full((HEIGHT, WIDTH), each, np.uint8) for each in (value, 120, value)]
    assert [len(np.unique(seen)) for seen in followed(pictures)] == [1, 1, 1]


def dull(picture: np.ndarray, contrast: float) -> np.ndarray:
    return lit(128.0 + contrast * (picture - picture.mean()), 1.0)


def spread(picture: np.ndarray) -> float:
    low, high = np.percentile(picture, [5, 95])
    return float(high - low)


@pytest.mark.parametrize(('contrast', 'expected'), [(0.5, 80.0), (0.3, 80.0), (0.1, 48.0), (0.9, 144.0)])
def test_dull_pictures_get_the_contrast_of_others(contrast: float, expected: float) -> None:
    """But at most three times theirs, 16; and others stay. 90 % of the scene's grey values are within 160."""
    picture = dull(scene()[:, :WIDTH], contrast)
    seen = followed([picture])[0]
    assert spread(seen) == pytest.approx(expected, abs=6.0)
    assert (seen is picture) == (contrast == 0.9)
    order = np.argsort(picture, axis=None, kind='stable')
    assert (np.diff(seen.ravel()[order].astype(int)) >= 0).all(), 'what was brighter still is'


@pytest.mark.parametrize('level', [0.0, 250.0])
def test_dull_pictures_near_black_or_white_lose_nothing(level: float) -> None:
    picture = lit(np.clip(level + 0.2 * (scene()[:, :WIDTH] - 115.0), 5.0, 250.0), 1.0)
    seen = followed([picture])[0]
    inner = (picture > np.percentile(picture, 6)) & (picture < np.percentile(picture, 94))
    assert len(np.unique(seen[inner])) == len(np.unique(picture[inner]))


def test_fog_that_comes_up_changes_the_contrast_slowly() -> None:
    picture = scene()[:, :WIDTH]
    found = followed([dull(picture, contrast) for contrast in [*np.linspace(1.0, 0.3, 100), *[0.3] * 150]])
    steps = [np.abs(later.astype(float) - earlier).mean() for earlier, later in pairwise(found)]
    assert max(steps) < 2.0
    assert spread(found[-1]) > 1.5 * spread(dull(picture, 0.3))


def cars_found(alpha: float, beta: float, flicker: float = 0.0) -> int:
    """In 60 pictures whose grey values are changed, in each by up to ``flicker`` more."""
    random, pipeline, count = np.random.default_rng(3), MotionPipeline(load_preset('visdrone')), 0
    for frame in Flight('visdrone', {}, 1, 60, WIDTH, HEIGHT, cars=60).pictures():
        gain = alpha * (1.0 + random.uniform(-flicker, flicker))
        image = cv2.convertScaleAbs(frame.image, alpha=gain, beta=beta)
        count += len(pipeline.process(image, frame.stamp_ns).detections)
    return count


def test_cars_are_found_under_a_lamp_that_flickers_and_in_haze() -> None:
    clear = cars_found(1.0, 0.0)
    assert clear > 60
    assert cars_found(1.0, 0.0, flicker=0.2) > 0.75 * clear
    assert cars_found(0.25, 150.0) > 0.85 * clear
