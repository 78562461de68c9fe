"""Jumps of the exposure and dull pictures, against the same pictures without them."""

from __future__ import annotations

import math
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


@pytest.mark.parametrize('share', [0.2, 0.5])
def test_what_is_masked_says_nothing_of_the_scene(share: float) -> None:
    """A bright hull of strong contrast below a dull scene in a light that flickers: the scene is as without it."""
    world, top = 90.0 + 0.15 * scene()[:, :WIDTH], round((1.0 - share) * HEIGHT)
    mask = np.ones((HEIGHT, WIDTH), np.bool_)
    mask[top:] = False
    hull = np.where(np.indices((HEIGHT - top, WIDTH)).sum(axis=0) // 8 % 2, 250, 5).astype(np.uint8)
    alone, beside = Brightness(), Brightness()
    for index, gain in enumerate([1.0, 1.0, 0.8, 1.2, 1.0] * 3):
        picture = lit(world[:top], gain)
        expected = alone.step(picture, (index + 1) * PERIOD_NS)
        found = beside.step(np.vstack([picture, hull]), (index + 1) * PERIOD_NS, mask)[:top]
        assert np.abs(found.astype(int) - expected).mean() < 1.5
        assert expected.std() > 2.0 * picture.std(), 'it is stretched'


@pytest.mark.parametrize('step_px', [0, 3, 6])
def test_pictures_in_flickering_light_are_as_bright_as_the_first(step_px: int) -> None:
    world, gains = scene(), [1.0, 0.8, 1.2, 1.0, 0.85, 1.15, 0.9]
    views = [world[:, step_px * index:step_px * index + WIDTH] for index in range(len(gains))]
    found = followed([lit(view, gain) for view, gain in zip(views, gains, strict=True)])
    for view, seen, gain in zip(views, found, gains, strict=True):
        assert np.abs(seen - view).mean() < 5.0, f'{gain}, of which 0.8 is 23 grey levels darker'


@pytest.mark.parametrize('hertz', [30.0, 29.97, 60.0, 25.0])
@pytest.mark.parametrize('depth', [0.03, 0.05, 0.06, 0.08, 0.15])
def test_a_lamp_on_the_mains_makes_nothing_darker_or_brighter_for_long(hertz: float, depth: float) -> None:
    """100 Hz: small steps one way, and larger ones back, or the other way round."""
    world = 0.8 * scene()[:, :WIDTH]
    phases = 2.0 * np.pi * 100.0 * np.arange(240) / hertz + np.pi / 2.0
    pictures = [lit(world, 1.0 + depth * math.cos(phase)) for phase in phases]
    found = followed(pictures, round(1e9 / hertz))
    off = [abs(seen.mean() / world.mean() - 1.0) for seen in found]
    assert max(off) < 0.1 + 2.0 * depth
    steps = [np.diff([each.mean() for each in those]) / world.mean() for those in (pictures, found)]
    assert np.abs(steps[1]).mean() < 0.005 + 1.05 * np.abs(steps[0]).mean(), 'no less steady than the lamp'


@pytest.mark.parametrize('gains', [(1.07, 1.14, 1.0), (0.94, 0.88, 1.0)])
def test_small_steps_one_way_and_a_jump_back_leave_the_brightness(gains: tuple[float, ...]) -> None:
    world = 0.8 * scene()[:, :WIDTH]
    found = followed([lit(world, gain) for gain in gains * 60])
    assert max(abs(seen.mean() / world.mean() - 1.0) for seen in found) < 0.25


@pytest.mark.parametrize('step_px', [20, 30, 60])
def test_in_a_fast_pan_under_a_lamp_nothing_adds_up(step_px: int) -> None:
    world = np.tile(scene(), (1, 4))
    gains = np.random.default_rng(1).choice([1.0, 0.8, 1.2], 50)
    for index, seen in enumerate(followed([
            lit(world[:, step_px * index:step_px * index + WIDTH], gain) for index, gain in enumerate(gains)])):
        view = world[:, step_px * index:step_px * index + WIDTH]
        assert 0.62 < seen.mean() / view.mean() < 1.6


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


@pytest.mark.parametrize('case', ['gap', 'backwards', 'far backwards', 'size', 'reset'])
def test_the_first_picture_after_a_break_is_as_it_comes(case: str) -> None:
    brightness, dark = Brightness(), lit(scene()[:, :WIDTH], 0.7)
    start = 10 ** 18 if case == 'far backwards' else 10 * PERIOD_NS
    brightness.step(lit(scene()[:, :WIDTH], 1.0), start)
    if case == 'size':
        dark = dark[:200]
    if case == 'reset':
        brightness.reset()
    assert brightness.step(dark, {'gap': 100, 'backwards': 9}.get(case, 11) * PERIOD_NS) is dark


@pytest.mark.parametrize(('hertz', 'gain'), [(25, 0.5), (10, 5.5), (10, 0.4), (5, 0.4), (2, 0.6), (1.1, 0.8)])
def test_light_that_has_changed_for_good_is_taken_over_at_any_frame_rate(hertz: float, gain: float) -> None:
    world = 0.25 * scene()[:, :WIDTH] + 20.0
    pictures = [lit(world, each) for each in [1.0] + [gain] * math.ceil(20 * hertz)]
    brightness = Brightness()
    found = [brightness.step(each, round((index + 1) * 1e9 / hertz)) for index, each in enumerate(pictures)]
    as_they_are = [Brightness().step(each, 1) for each in pictures]  # stretched as the first of a camera
    assert np.abs(found[-1].astype(float) - as_they_are[-1]).mean() < 3.0


@pytest.mark.parametrize('value', [0, 5, 128, 255])
@pytest.mark.parametrize('count', [1, 40])
def test_pictures_after_black_and_white_ones_are_as_they_come(value: int, count: int) -> None:
    blank = np.full((HEIGHT, WIDTH), value, np.uint8)
    found = followed([*[blank] * count, *[lit(scene()[:, :WIDTH], 1.0)] * 20])
    for seen in found[count:]:
        np.testing.assert_array_equal(seen, lit(scene()[:, :WIDTH], 1.0))


def under_a_bright_sky() -> np.ndarray:
    picture = scene()[:, :WIDTH].copy()
    picture[:HEIGHT * 45 // 100] = 0.1 * picture[:HEIGHT * 45 // 100] + 215.0
    return picture


DAMAGED = {
    'black': np.zeros_like, 'grey': lambda view: np.full_like(view, 128),
    'dark grey': lambda view: np.full_like(view, 60), 'white': lambda view: np.full_like(view, 255),
    'noise': lambda view: np.random.default_rng(1).integers(0, 256, view.shape, np.uint8),
    'another scene': lambda view: lit(255.0 - 0.7 * scene(9)[:, :WIDTH], 1.0),
    'lower half grey': lambda view: np.vstack([view[:HEIGHT // 2], np.full_like(view[HEIGHT // 2:], 128)]),
    'lower half black': lambda view: np.vstack([view[:HEIGHT // 2], np.zeros_like(view[HEIGHT // 2:])]),
}


VIEWS = {
    'scene': lit(scene()[:, :WIDTH], 1.0), 'under a bright sky': lit(under_a_bright_sky(), 1.0),
    'night': lit(scene()[:, :WIDTH], 0.2), 'fog': lit(0.35 * scene()[:, :WIDTH] + 130.0, 1.0),
}


@pytest.mark.parametrize('damage', DAMAGED)
@pytest.mark.parametrize('world', VIEWS)
def test_a_damaged_picture_changes_no_other(world: str, damage: str) -> None:
    found = followed([*[VIEWS[world]] * 10, DAMAGED[damage](VIEWS[world]), *[VIEWS[world]] * 10])
    for seen in found[11:]:
        assert np.abs(seen.astype(float) - found[9]).mean() < 3.0


def test_after_a_cut_pictures_are_as_they_come() -> None:
    bright, shade = lit(scene()[:, :WIDTH], 1.0), scene(5)[:, :WIDTH]
    shade = lit(np.where(np.arange(WIDTH) < 0.8 * WIDTH, 0.4 * shade, shade), 1.0)
    for seen in followed([*[bright] * 5, *[shade] * 25])[5:]:
        np.testing.assert_array_equal(seen, shade)


@pytest.mark.parametrize('gain', [0.3, 0.6, 1.7, 3.0])
def test_what_was_brighter_still_is_after_a_jump_of_the_exposure(gain: float) -> None:
    world = np.clip(scene()[:, :WIDTH], 0.0, None)
    world[:40] = np.linspace(0.0, 255.0, WIDTH)
    picture = lit(world, gain)
    seen = followed([lit(world, 1.0), picture])[1]
    order = np.argsort(picture, axis=None, kind='stable')
    assert (np.diff(seen.ravel()[order].astype(int)) >= 0).all()


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


@pytest.mark.parametrize('contrasts', [
    [0.15, *[0.6] * 80], [*[0.2] * 50, *[0.6] * 80], [*[0.2] * 50, *[0.45] * 80],
    [*[0.2] * 50, *np.linspace(0.2, 0.6, 10), *[0.6] * 80], [*[0.15] * 50, *np.linspace(0.15, 0.7, 50), *[0.7] * 80],
], ids=['first picture', 'at once', 'to little', 'soon', 'slowly'])
def test_fog_that_clears_makes_no_other_jump(contrasts: list[float]) -> None:
    picture = scene()[:, :WIDTH]
    pictures = [dull(picture, contrast) for contrast in contrasts]
    found = followed(pictures)
    steps, own = ([np.abs(later.astype(float) - earlier).mean() for earlier, later in pairwise(those)]
                  for those in (found, pictures))
    assert all(step < 3.0 * one + 2.0 for step, one in zip(steps, own, strict=True)), 'three times is the most'
    assert all(np.isin(seen, (0, 255)).mean() < 0.01 for seen in found), 'next to nothing becomes black or white'


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


def levels(case: str) -> list[float]:
    """Mean grey values of 100 dull pictures, by case."""
    return {'cut to bright': [60.0] * 25 + [150.0] * 75, 'cut to dark': [170.0] * 25 + [60.0] * 75,
            'exposure goes up': [60.0] * 25 + [*np.linspace(60.0, 150.0, 20)] + [150.0] * 55,
            'exposure goes down': [170.0] * 25 + [*np.linspace(170.0, 60.0, 20)] + [60.0] * 55,
            'from bright to dark and back': [*np.linspace(190.0, 40.0, 30), *np.linspace(40.0, 190.0, 70)]}[case]


@pytest.mark.parametrize('case', [
    'cut to bright', 'cut to dark', 'exposure goes up', 'exposure goes down', 'from bright to dark and back'])
@pytest.mark.parametrize('gained', [False, True], ids=['haze', 'gain'])
def test_dull_pictures_of_another_brightness_show_no_less(case: str, gained: bool) -> None:
    """Haze adds to the grey values, the exposure multiplies them."""
    world, found, pictures = scene(), [], []
    brightness = Brightness()
    for index, level in enumerate(levels(case)):
        view = world[:, 4 * (index % 100):4 * (index % 100) + WIDTH] - 75.0
        pictures.append(lit(level + 0.12 * (level / 100.0 if gained else 1.0) * view, 1.0))
        found.append(brightness.step(pictures[-1], (index + 1) * PERIOD_NS))
    for index, (picture, seen) in enumerate(zip(pictures, found, strict=True)):
        low, high = np.percentile(picture, [5, 95])
        inner = (picture > low + 1) & (picture < high - 1)
        assert not np.isin(seen[inner], (0, 255)).any(), f'picture {index}'
        assert spread(seen) > 1.2 * spread(picture), f'picture {index}'


def test_what_moves_is_found_while_the_light_of_a_dull_day_changes() -> None:
    """An object in front of a hazy scene whose exposure goes up by a factor of 2.5 in 0.8 s."""
    random, count = np.random.default_rng(1), []
    world, thing = (cv2.GaussianBlur(random.normal(size=size), (0, 0), 2.5) * 12.0 for size in ((360, 1000), (40, 60)))
    pipeline = MotionPipeline(load_preset('default'))
    for index in range(90):
        view = world[:, 4 * index:4 * index + 640].copy()
        left = (20 + 8 * index) % 560
        view[100:140, left:left + 60] = thing
        image = lit(60.0 + 5.0 * view, 2.5 ** min(1.0, max(0.0, (index - 25) / 20.0)))
        count.append(len(pipeline.process(image, (index + 1) * PERIOD_NS).detections))
    pipeline.wait()
    assert np.count_nonzero(count[5:25]) > 5, 'as it begins'
    assert np.count_nonzero(count[45:70]) > 5, 'and once it is brighter'
