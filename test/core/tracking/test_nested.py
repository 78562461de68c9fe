"""Tracks in one another's place."""

from __future__ import annotations

import numpy as np
import pytest

from motion_detect_ros.core.detection.candidate import Candidate
from motion_detect_ros.core.geometry.boxes import shared_areas
from motion_detect_ros.core.tracking.nested import known_longest
from motion_detect_ros.core.tracking.track import Track


def track(left: float, width: float, age: int, speed: float = 10.0) -> Track:
    seen = Candidate(np.array([left + width / 2.0, 50.0]), np.array([width, 20.0]), np.array([speed, 0.0]), 1.0, 1.0, 1)
    one = Track(seen, 0.04)
    one.age = age
    return one


def kept(*tracks: Track) -> list[int]:
    return [tracks.index(one) for one in known_longest(list(tracks))]


def test_of_two_in_one_place_the_older_stays():
    assert kept(track(0, 100, 3), track(10, 40, 9)) == [1]
    assert kept(track(0, 100, 9), track(10, 40, 9)) == [0]  # of the same age the first
    assert kept(track(0, 100, 3), track(69, 100, 9), track(300, 20, 1)) == [0, 1, 2]  # 31 of 100 are shared
    assert kept(track(0, 100, 3, speed=10.0), track(10, 40, 9, speed=-1.0)) == [0, 1]  # it crosses it
    assert kept() == [] and kept(track(0, 100, 1)) == [0]


def test_what_an_older_one_hides_hides_nothing():
    """Each is 80 % in the next one: the second goes for the first, so the third stays."""
    assert kept(track(40, 100, 1), track(20, 100, 5), track(0, 100, 9), track(500, 10, 2)) == [0, 2, 3]


@pytest.mark.parametrize('seed', range(3))
def test_shared_areas_are_those_of_counted_pixels(seed: int) -> None:
    random = np.random.default_rng(seed)
    low = random.integers(0, 30, (9, 2))
    high = low + random.integers(0, 20, (9, 2))
    masks = np.zeros((9, 50, 50), bool)
    for mask, (left, top), (right, bottom) in zip(masks, low, high, strict=True):
        mask[top:bottom, left:right] = True
    ones, others = (low[:4].astype(float), high[:4].astype(float)), (low[4:].astype(float), high[4:].astype(float))
    np.testing.assert_array_equal(
        shared_areas(ones, others), (masks[:4, None] & masks[None, 4:]).sum(axis=(2, 3)))
