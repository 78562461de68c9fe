"""The publisher's rate and what was lost, from stamps of images thrown away by hand."""

from __future__ import annotations

import random

import pytest

from motion_detect_ros.bridge.gaps import ENOUGH, GapWatch, Losses

PERIOD = 100_000_000


def losses(stamps: list[float]) -> Losses | None:
    watch = GapWatch()
    for stamp in stamps:
        watch.add(round(stamp * PERIOD))
    return watch.losses()


@pytest.mark.parametrize('share', [0.2, 0.5, 0.8])
def test_share_of_images_thrown_away_at_random(share: float):
    chance = random.Random(1)
    kept = [index for index in range(2000) if chance.random() > share]
    found = [each for end in range(200, len(kept), 10) if (each := losses(kept[:end]))]
    assert found
    near = [each for each in found if each.published_hz == pytest.approx(10.0, rel=0.01)]
    assert len(near) > 0.95 * len(found)
    assert sum(each.share for each in near) / len(near) == pytest.approx(share, abs=0.06)


def test_a_camera_that_stamps_with_jitter_and_loses_nothing():
    chance = random.Random(2)
    found = losses([index + chance.uniform(-0.05, 0.05) for index in range(200)])
    assert found is not None
    assert found.share < 0.05


def test_a_camera_without_a_period_says_nothing_or_little():
    chance = random.Random(3)
    stamps, now = [], 0.0
    for _ in range(200):
        now += chance.uniform(0.2, 3.0)
        stamps.append(now)
    found = losses(stamps)
    assert found is None


def test_every_second_image_left_out_by_the_driver_is_a_slower_camera():
    found = losses(list(range(0, 200, 2)))
    assert found == Losses(pytest.approx(5.0), 0.0)


def test_too_few_images_and_a_clock_that_goes_back():
    assert losses(list(range(ENOUGH))) is None
    assert losses([*range(50), *range(ENOUGH)]) is None
    assert losses([*range(50), *range(ENOUGH + 1)]) is not None
