"""Nothing moves: houses, trees and parked cars under a camera that flies, turns, shakes and zooms, in rain."""

from __future__ import annotations

import pytest

from motion_detect_ros.benchmarks.silence import Flight

FRAMES, WIDTH_PX, HEIGHT_PX = 300, 480, 270


@pytest.mark.parametrize('preset', ['visdrone', 'kitti'])
@pytest.mark.parametrize('seed', [1, 2, 3])
def test_at_most_one_false_box_in_a_hundred_frames(preset: str, seed: int) -> None:
    flight = Flight(preset, {}, seed, FRAMES, WIDTH_PX, HEIGHT_PX)
    assert flight.boxes() <= FRAMES // 100


def test_the_same_flight_with_cars_is_not_silent() -> None:
    assert Flight('visdrone', {}, 1, 60, WIDTH_PX, HEIGHT_PX, cars=60).boxes() > 60
