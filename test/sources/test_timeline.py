"""When messages are played and what /clock shows then, by hand: seconds of recording against seconds of play."""

from __future__ import annotations

import pytest

from motion_detect_ros.core.types import NANOSECONDS
from motion_detect_ros.sources.raw import RawMessage
from motion_detect_ros.sources.timeline import timeline

T = 1_700_000_000
#: What MCAP has room for, and ROS times have not.
WILD = [2.0**63 / NANOSECONDS, 2.0**64 / NANOSECONDS - 1, 2.0**31]


def played(*recorded_s: float, origin_s: float = T) -> list[tuple[float, float, float]]:
    """(position, clock, jump) of messages recorded at these times after the origin, seconds."""
    stamps = [round((origin_s + second) * 1000) * 1_000_000 for second in recorded_s]
    messages = (RawMessage('/a', 'b', stamp, b'c') for stamp in stamps)
    return [(timed.position_ns / NANOSECONDS, round(timed.clock_ns / NANOSECONDS - origin_s, 3),
             round(timed.jump_ns / NANOSECONDS, 3)) for timed in timeline(messages)]


def test_pauses_are_kept() -> None:
    assert played(0, 0.5, 3600, 50_000) == [(0, 0, 0), (0.5, 0.5, 0), (3600, 3600, 0), (50_000, 50_000, 0)]


def test_what_was_written_late_turns_nothing_back() -> None:
    assert played(0, 1, 0.5, 2) == [(0, 0, 0), (1, 1, 0), (1, 1, 0), (2, 2, 0)]


def test_a_clock_that_was_set_back_goes_on_from_there_at_the_recorded_pace() -> None:
    assert played(3600, 3601, 0, 1, 2) == [(0, 3600, 0), (1, 3601, 0), (1, 0, -3601), (2, 1, 0), (3, 2, 0)]


def test_a_clock_that_was_set_ahead_by_more_than_a_day_is_not_waited_for() -> None:
    assert played(0, 1, 100_000, 100_001) == [(0, 0, 0), (1, 1, 0), (1, 100_000, 99_999), (2, 100_001, 0)]


@pytest.mark.parametrize('odd', [-5000, -2, 5, 100_000, *(wild - T for wild in WILD), -T, -T - 5])
def test_one_message_with_another_time_is_played_in_its_place(odd: float) -> None:
    assert [entry[:2] for entry in played(0, 1, odd, 2, 3)] == [(0, 0), (1, 1), (1, 1), (2, 2), (3, 3)]


@pytest.mark.parametrize('odd', [100_000, *(wild - T for wild in WILD)])
def test_a_wild_time_at_the_end_is_not_waited_for(odd: float) -> None:
    assert [entry[:2] for entry in played(0, 1, odd)] == [(0, 0), (1, 1), (1, 1)]


def test_a_recorder_that_began_without_the_date() -> None:
    assert played(-T, 0, 1) == [(0, -T, 0), (0, 0, T), (1, 1, 0)]


@pytest.mark.parametrize('wild', WILD)
def test_a_wild_time_at_the_beginning(wild: float) -> None:
    assert played(wild - T, 0, 1) == [(0, -T, 0), (0, 0, T), (1, 1, 0)]


def test_nothing() -> None:
    assert played() == []
