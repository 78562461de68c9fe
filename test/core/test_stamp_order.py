"""Decisions about stamps, against the order in which images were taken."""

from __future__ import annotations

import pytest
from hypothesis import given
from hypothesis import strategies as st

from motion_detect_ros.core.stamp_order import RUN_OF_LATE, StampOrder, Verdict

PERIOD = 100_000_000
NEXT, JUMP, SEEN, LATE = Verdict.NEXT, Verdict.JUMP, Verdict.SEEN, Verdict.LATE


def judged(*stamps: float, reorder_s: float = 0.3) -> list[Verdict]:
    """Verdicts about images of these times, in tenths of a second."""
    order = StampOrder(reorder_s)
    return [order.judge(round(stamp * PERIOD)) for stamp in stamps]


def test_images_in_order_are_next_whatever_lies_between_them():
    assert judged(1, 2, 3, 50, 51) == [NEXT] * 5


def test_every_image_twice():
    assert judged(1, 1, 2, 2, 3, 3) == [NEXT, SEEN] * 3


def test_two_swapped_images_cost_the_later_one_only():
    assert judged(1, 3, 2, 4) == [NEXT, NEXT, LATE, NEXT]


def test_shuffled_by_three():
    assert judged(3, 2, 1, 6, 5, 4, 8, 7, 9) == [NEXT, LATE, LATE, NEXT, LATE, LATE, NEXT, LATE, NEXT]


def test_a_jump_back_by_the_limit_or_more_starts_anew():
    assert judged(10, 11, 8, 9, 10) == [NEXT, NEXT, JUMP, NEXT, NEXT]
    assert judged(10, 11, 8.01) == [NEXT, NEXT, LATE]
    assert judged(10, 9, 8, reorder_s=0.0) == [NEXT, JUMP, JUMP]


def test_a_clock_that_went_back_by_less_starts_anew_after_a_few_images():
    """At 100 Hz, 0.2 s back."""
    late = [8 + index / 10 for index in range(RUN_OF_LATE)]
    assert judged(9.9, 10, *late, late[-1] + 0.1) == [NEXT, NEXT, *[LATE] * (RUN_OF_LATE - 1), JUMP, NEXT]


def test_a_camera_that_does_not_stamp_is_told_from_a_recording_that_begins_at_0():
    assert judged(0, 0, 0) == [NEXT, Verdict.MISSING, Verdict.MISSING]
    assert judged(0, 1, 2) == [NEXT, NEXT, NEXT]


def test_one_image_without_a_stamp_among_dated_ones_is_left_out_and_forgotten():
    today = 17_000_000_000
    assert judged(today, today + 1, 0, today + 2) == [NEXT, NEXT, Verdict.MISSING, NEXT]
    assert judged(today, 0, 0, 1) == [NEXT, Verdict.MISSING, Verdict.MISSING, JUMP]
    assert judged(500, 0, 1) == [NEXT, JUMP, NEXT]  # a simulation that starts again


def test_stamps_before_1970_are_left_out_and_forgotten():
    assert judged(-1, 5, -1, 6) == [Verdict.NEGATIVE, NEXT, Verdict.NEGATIVE, NEXT]


def test_a_stamp_that_stands_still_never_starts_anew():
    assert judged(5, *[5] * 50) == [NEXT, *[SEEN] * 50]
    assert judged(5, *[4] * 50) == [NEXT, *[LATE] * 50]


def test_two_cameras_on_one_topic_whose_clocks_differ_by_less_than_the_limit_give_one():
    stamps = [stamp for index in range(20) for stamp in (index, index - 1.5) if stamp >= 0]
    verdicts = dict(zip(stamps, judged(*stamps), strict=True))
    assert {verdict for stamp, verdict in verdicts.items() if stamp % 1 == 0} == {NEXT}
    assert {verdict for stamp, verdict in verdicts.items() if stamp % 1 == 0.5} == {LATE}


@given(st.lists(st.integers(-3, 40), max_size=60), st.sampled_from([0.0, 0.1, 0.3, 1.0]))
def test_stamps_of_usable_images_increase_between_jumps_and_all_are_counted(stamps: list[int], reorder_s: float):
    order, latest = StampOrder(reorder_s), -1
    for stamp in stamps:
        verdict = order.judge(stamp * PERIOD)
        if verdict == NEXT:
            assert stamp > latest
        latest = stamp if verdict.usable else latest
    assert order.counts.total() == len(stamps)


@pytest.mark.parametrize('verdict', Verdict)
def test_only_two_verdicts_are_usable(verdict: Verdict):
    assert verdict.usable == (verdict in (NEXT, JUMP))


def test_a_stamp_that_no_message_can_carry_is_left_out_and_forgotten():
    """Seconds are int32 in ROS: up to 2038-01-19 03:14:07."""
    latest = 2 ** 31 * 1_000_000_000 - 1
    order = StampOrder()
    assert [order.judge(stamp) for stamp in (1, latest + 1, 2 ** 64, 2, latest, 3)] == [
        NEXT, Verdict.BEYOND, Verdict.BEYOND, NEXT, NEXT, JUMP]
