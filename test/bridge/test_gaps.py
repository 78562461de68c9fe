"""The publisher's rate and what was lost, from stamps of images thrown away by hand, and what is said of a stream."""

from __future__ import annotations

import random

import pytest

from motion_detect_ros.bridge.gaps import ENOUGH, GapWatch, Losses
from motion_detect_ros.bridge.image_stream import ImageStream
from motion_detect_ros.core.stamp_order import Verdict

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


SECOND = 1_000_000_000


def streamed(periods: list[float], compressed: bool = False) -> ImageStream:
    stream = ImageStream(compressed)
    for period in periods:
        stream.add(Verdict.NEXT, round(period * PERIOD), round(period * PERIOD), stamped=True)
    return stream


@pytest.mark.parametrize(('verdict', 'stamped', 'words'), [
    (Verdict.SEEN, True, 'images with a stamp that was seen already are left out'),
    (Verdict.LATE, True, 'images that come after later ones are left out'),
    (Verdict.NEXT, False, 'images carry no stamp (all zero), their time of arrival is used'),
])
def test_trouble_with_stamps_is_told_for_three_seconds(verdict: Verdict, stamped: bool, words: str):
    stream = ImageStream(False)
    assert stream.trouble(20 * SECOND) == ''
    stream.add(verdict, 5, 20 * SECOND, stamped=stamped)
    stream.add(Verdict.NEXT, 6, 21 * SECOND, stamped=True)
    assert [stream.trouble(now_ns) for now_ns in (20 * SECOND, 23 * SECOND, 23 * SECOND + 1)] == [words, words, '']


@pytest.mark.parametrize('verdict', [verdict for verdict in Verdict if not verdict.usable])
def test_stamps_of_images_that_are_left_out_say_nothing_of_the_rate(verdict: Verdict):
    """As far ahead or back as they may be; one comes after each image of 10 Hz."""
    wrong = {Verdict.SEEN: 0, Verdict.LATE: -2 * PERIOD, Verdict.BEYOND: 2 ** 62}
    stream = ImageStream(False)
    for index in range(100, 130):
        stream.add(Verdict.NEXT, index * PERIOD, index * PERIOD, stamped=True)
        stream.add(verdict, index * PERIOD + wrong.get(verdict, -index * PERIOD), index * PERIOD, stamped=True)
    assert dict(stream.values()) == {'published_hz': '10.000', 'lost_share': '0.000'}
    assert stream.loss() == ''


def test_times_of_arrival_say_nothing_of_the_rate():
    stream = ImageStream(False)
    for index in range(30):
        stream.add(Verdict.NEXT, index * PERIOD, index * PERIOD, stamped=False)
    assert dict(stream.values()) == {'published_hz': 'nan', 'lost_share': 'nan'}


def test_losses_over_a_fifth_are_told_with_what_helps():
    """Two of four arrive: 12 gaps of one period and 11 of three, so that 22 of 45 images are lost."""
    half = [index + 4 * number for number in range(12) for index in (0, 1)]
    words = '49% of the images do not arrive (published at 10.0 Hz by their stamps): '
    assert streamed(half).loss().startswith(f'{words}set image_transport:=compressed')
    assert streamed(half, compressed=True).loss().startswith(f'{words}use a reliable publisher')
    assert dict(streamed(half).values()) == {'published_hz': '10.000', 'lost_share': '0.489'}
    assert streamed([index for index in range(44) if index % 6]).loss() == ''  # a sixth is lost
