"""Sums of frame periods against seconds."""

from __future__ import annotations

import pytest

from motion_detect_ros.core.periods import Every, exceeded, reached


@pytest.mark.parametrize(('hz', 'frames'), [(5.0, 2), (10.0, 2), (15.0, 2), (20.0, 2), (25.0, 3), (30.0, 3), (60.0, 6)])
def test_a_tenth_of_a_second_in_whole_frames(hz: float, frames: int) -> None:
    every, done = Every(0.1), []
    for index in range(13):
        jitter_s = (0.001, -0.001)[index % 2]
        if every.due(1.0 / hz + jitter_s):
            every.done()
            done.append(index)
    assert done == list(range(0, 13, frames))


@pytest.mark.parametrize(('hz', 'frames'), [
    (5.0, [0, 2, 4, 6]), (10.0, [0, 2, 4, 6]), (20.0, [0, 1, 2, 4, 6]), (25.0, [0, 1, 2, 3, 6]),
    (60.0, [0, 1, 2, 3, 4, 5, 6])])
def test_eager_is_also_in_the_first_tenth_of_a_second_and_turns_stay(hz: float, frames: list[int]) -> None:
    every, done = Every(0.1, eager=True), []
    for start in (0, 7):
        for index in range(7):
            if every.due(1.0 / hz):
                every.done()
                done.append(start + index)
        every.reset()
    assert done == [*frames, *(7 + frame for frame in frames)]


def test_what_was_due_and_not_done_stays_due() -> None:
    every = Every(0.1)
    assert every.due(0.04) and every.due(0.04)
    every.done()
    assert [every.due(0.04) for _ in range(4)] == [False, False, True, True]


def test_zero_seconds_is_every_frame_and_reset_makes_a_first_one() -> None:
    always = Every(0.0)
    for _ in range(3):
        assert always.due(0.04)
        always.done()
    every = Every(10.0)
    assert every.due(0.0)
    every.done()
    assert not every.due(0.04)
    every.reset()
    assert every.due(0.04)


def test_jitter_is_a_quarter_of_a_period() -> None:
    assert reached(0.115, 0.12, 0.04) and not reached(0.105, 0.12, 0.04)
    assert exceeded(0.135, 0.12, 0.04) and not exceeded(0.125, 0.12, 0.04)
