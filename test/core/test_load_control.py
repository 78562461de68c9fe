"""Work that follows the load, and what changes with the working width."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from motion_detect_ros.core.load_control import STEPS, LoadControl
from motion_detect_ros.core.pipeline import MotionPipeline
from motion_detect_ros.sources.synthetic import FlightConfig, SyntheticFlight

PERIOD_S = 0.04


def played(control: LoadControl, full_ms: float, seconds: int) -> list[int]:
    """Numbers of the steps while a received image at full work would take ``full_ms``."""
    numbers = []
    for _ in range(seconds):
        control.decide(1e-3 * full_ms * control.step.cost * control.step.of, PERIOD_S)
        numbers.append(control.number)
    return numbers


def test_nothing_changes_while_there_is_time() -> None:
    control = LoadControl()
    assert played(control, 35.0, 50) == [0] * 50
    assert control.step.reduced == ''


@pytest.mark.parametrize(('full_ms', 'number'), [(45.0, 1), (70.0, 2), (110.0, 3), (150.0, 4)])
def test_one_decision_finds_a_step_that_fits(full_ms: float, number: int) -> None:
    control = LoadControl()
    assert played(control, full_ms, 20) == [number] * 20
    share, of = STEPS[number].width_share, STEPS[number].of
    words = control.step.reduced
    assert f'{share:.0%}' in words and (f'1 image of {of}' if of > 1 else 'every image') in words
    assert control.step == STEPS[number]
    assert 1e-3 * full_ms * STEPS[number].cost <= PERIOD_S


def test_it_comes_back_when_the_load_is_gone() -> None:
    control = LoadControl()
    played(control, 250.0, 5)
    back = played(control, 15.0, 30)
    assert back[-1] == 0 and sorted(back, reverse=True) == back
    assert back[0] == 4  # not at the first sight of room


def test_a_dear_start_leaves_no_images_out_for_good() -> None:
    """The first second costs more than the later ones; then every image fits at half the width, a quarter to spare."""
    control = LoadControl()
    assert played(control, 110.0, 1) == [3]
    assert played(control, 60.0, 30)[-1] == 2


def test_one_dear_second_leaves_no_images_out() -> None:
    """A few of them wait for one second; to leave out every other one takes two."""
    control = LoadControl()
    assert played(control, 70.0, 5) == [2] * 5
    assert played(control, 90.0, 1) == [2]
    assert played(control, 70.0, 5) == [2] * 5
    assert played(control, 90.0, 2) == [2, 3]


def test_a_dear_second_ends_a_row_of_those_with_room() -> None:
    """Room has to be there for three seconds in a row, also where nothing more was done about the dear one."""
    control = LoadControl()
    played(control, 70.0, 1)
    assert played(control, 40.0, 2) == [2, 2]
    assert played(control, 90.0, 1) == [2]
    assert played(control, 40.0, 3) == [2, 2, 1]


def test_a_load_that_just_does_not_fit_is_tried_less_and_less_often() -> None:
    """The costs of the steps are estimates: here the smaller step promises room that is not there."""
    control, tries = LoadControl(), []
    for second in range(300):
        number = control.number
        load_ms = {0: 45.0, 1: 15.0}[number]
        before = number
        control.decide(1e-3 * load_ms, PERIOD_S)
        if control.number < before:
            tries.append(second)
    gaps = np.diff(tries)
    assert len(tries) >= 4 and (np.diff(gaps) >= 0).all() and gaps[-1] >= 2 * gaps[0]


def test_relapses_of_days_ago_do_not_count() -> None:
    """Three seconds of patience again once full work has held for an hour."""
    control = LoadControl()
    for _ in range(5):
        played(control, 45.0, 1)
        while control.number:
            played(control, 15.0, 1)
        played(control, 45.0, 1)  # a relapse
        while control.number:
            played(control, 15.0, 1)
        played(control, 15.0, 3600)
    played(control, 45.0, 1)
    assert played(control, 15.0, 4) == [1, 1, 0, 0]


def test_a_try_that_fails_ends_where_it_began() -> None:
    """The points start anew with the width, so the first second at the larger step costs more than it will."""
    control = LoadControl()
    played(control, 75.0, 1)
    assert control.number == 2
    numbers = []
    for _ in range(60):
        load_ms = {0: 90.0, 1: 70.0, 2: 18.0}.get(control.number, 9.0)
        control.decide(1e-3 * load_ms * control.step.of, PERIOD_S)
        numbers.append(control.number)
    assert numbers.count(1) >= 2 and set(numbers) == {1, 2}


def test_the_last_step_stays_under_any_load() -> None:
    assert set(played(LoadControl(), 5000.0, 10)) == {len(STEPS) - 1}


def test_another_working_width_in_mid_flight_keeps_track_and_velocity() -> None:
    config = replace(FlightConfig.single(80.0, 4.0, 2.0, direction_deg=30.0, frames=45), width=960, height=540)
    flight = SyntheticFlight(config)
    pipeline = MotionPipeline()
    shares = {15: 0.75, 22: 0.5, 30: 1.0}
    found = []
    for index, frame in enumerate(flight):
        if index in shares:
            pipeline.limit_width(shares[index])
        result = pipeline.process(frame.image, frame.stamp_ns)
        assert result.ego.ok or index == 0, index
        found.append(result.detections)
    late = found[10:]
    assert [len(each) for each in late] == [1] * len(late)
    assert len({int(each['id'][0]) for each in late}) == 1
    speed = np.array([np.hypot(each['vel_u'][0], each['vel_v'][0]) for each in late])
    assert np.abs(speed / (4.0 * config.fps) - 1.0).max() < 0.25
    assert np.abs(np.median(speed) / (4.0 * config.fps) - 1.0) < 0.1
