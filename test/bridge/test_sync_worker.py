"""The join of inputs, and the worker's mailbox."""

from __future__ import annotations

import threading
import time
from collections.abc import Callable
from dataclasses import dataclass

from hypothesis import given
from hypothesis import strategies as st

from motion_detect_ros.bridge.sync import MOST_SETS, ROOM_BYTES, ExactJoin, size_of
from motion_detect_ros.bridge.worker import Worker
from motion_detect_ros.core.stamp_order import Verdict

#: A safety net for what must come.
TIMEOUT_S = 300.0


def test_joins_by_equal_stamps_in_the_order_of_the_names():
    join = ExactJoin(('image', 'flow'), 4)
    assert join.add('flow', 10, 'f10') is None
    assert join.add('image', 10, 'i10') == ('i10', 'f10')
    assert join.add('image', 11, 'i11') is None
    assert join.add('flow', 11, 'f11') == ('i11', 'f11')
    assert join.dropped == 0


def test_older_incomplete_sets_are_dropped_and_counted():
    join = ExactJoin(('image', 'flow'), 4)
    join.add('image', 1, 'i1')
    join.add('image', 2, 'i2')
    assert join.add('flow', 2, 'f2') == ('i2', 'f2')
    assert join.dropped == 1
    assert join.add('flow', 1, 'f1') is None


def test_what_is_absent_is_what_the_longest_waiting_set_lacks():
    join = ExactJoin(('image', 'ego_motion', 'flow'), 4)
    assert join.absent() == ()
    join.add('image', 10, 'i10')
    assert join.absent() == ('ego_motion', 'flow')
    join.add('image', 11, 'i11')
    join.add('ego_motion', 11, 'e11')
    assert join.absent() == ('ego_motion', 'flow')
    assert join.add('flow', 11, 'f11') is not None
    assert join.absent() == ()
    join.add('flow', 12, 'f12')
    assert join.absent() == ('image', 'ego_motion')


@st.composite
def ordered_topics(draw: st.DrawFn) -> tuple[list[tuple[str, int]], dict[str, set[int]]]:
    """Three topics, each in order of its stamps but with gaps, interleaved anyhow."""
    kept = {name: draw(st.sets(st.integers(0, 15))) for name in 'abc'}
    queues = {name: sorted(stamps) for name, stamps in kept.items()}
    order = draw(st.permutations([name for name, stamps in kept.items() for _ in stamps]))
    return [(name, queues[name].pop(0)) for name in order], kept


@given(ordered_topics())
def test_of_ordered_topics_all_common_stamps_come_out_in_order_and_every_other_is_accounted_for(topics):
    arrivals, kept = topics
    join = ExactJoin(('a', 'b', 'c'), 100)
    emitted = [items[0] for items in (join.add(name, stamp, stamp) for name, stamp in arrivals) if items]
    common, all_stamps = set.intersection(*kept.values()), set.union(*kept.values())
    assert emitted == sorted(common)
    before_the_last = {stamp for stamp in all_stamps - common if stamp < max(common, default=-1)}
    assert join.dropped >= len({stamp for stamp in before_the_last if _arrived_first(arrivals, stamp, max(common))})
    assert join.dropped + len(join._waiting) == len(all_stamps - common)


def _arrived_first(arrivals: list[tuple[str, int]], stamp: int, last: int) -> bool:
    """Whether something of ``stamp`` came before the set of ``last`` was complete."""
    completed = max(index for index, (_, when) in enumerate(arrivals) if when == last)
    return any(when == stamp for _, when in arrivals[:completed])


def test_after_the_stamps_jump_back_sets_complete_again():
    join = ExactJoin(('image', 'flow'), 3)
    for stamp in (100, 101):
        join.add('image', stamp, 'i')
        assert join.add('flow', stamp, 'f')
    join.add('image', 102, 'left over')
    for stamp in (1, 2, 3):
        join.add('image', stamp, f'i{stamp}')
        assert join.add('flow', stamp, f'f{stamp}') == (f'i{stamp}', f'f{stamp}')
    join.clear()
    assert join.add('flow', 102, 'f') is None


def test_after_a_jump_back_nothing_of_the_earlier_run_meets_the_present_one():
    join = ExactJoin(('image', 'flow'), 10)
    for stamp in (3, 4):
        join.add('image', stamp, f'old i{stamp}')
    join.add('flow', 5, 'old f5')
    for stamp in (1, 2, 3, 4, 5):
        assert join.add('flow', stamp, f'f{stamp}') is None
        assert join.add('image', stamp, f'i{stamp}') == (f'i{stamp}', f'f{stamp}')


def test_the_answer_to_the_first_image_after_a_small_step_back_meets_it():
    """The clock steps back by 6 images: the stage before leaves four of them out, as here, and answers the fifth."""
    join = ExactJoin(('image', 'ego_motion'), 10, reorder_s=1e-7)
    for stamp in range(10, 101, 10):
        join.add('image', stamp, 'i')
        assert join.add('ego_motion', stamp, 'e')
    for stamp in (50, 60, 70, 80):
        assert (join.add('image', stamp, 'late'), join.verdict) == (None, Verdict.LATE)
    for stamp in (90, 100, 110):
        assert join.add('image', stamp, f'i{stamp}') is None
        assert join.add('ego_motion', stamp, f'e{stamp}') == (f'i{stamp}', f'e{stamp}')
    assert join.count('image', Verdict.JUMP) == 1


def test_items_of_the_other_topic_before_its_own_jump_are_forgotten_with_it():
    join = ExactJoin(('image', 'flow'), 10)
    join.add('image', 9, 'old')
    join.add('image', 1, 'i1')
    assert (join.dropped, join.add('flow', 8, 'late f8')) == (1, None)
    assert join.add('flow', 1, 'f1') == ('i1', 'f1')
    assert join.dropped == 2
    assert join.add('image', 8, 'i8') is None
    assert join.add('flow', 8, 'f8') == ('i8', 'f8')


@given(st.lists(st.tuples(st.sampled_from('abc'), st.integers(0, 12)), max_size=200), st.integers(1, 6))
def test_memory_is_bounded_and_nothing_is_lost_uncounted(inputs, capacity):
    join, complete = ExactJoin(('a', 'b', 'c'), capacity), []
    started = set()
    for name, stamp in inputs:
        started.add(stamp)
        items = join.add(name, stamp, (name, stamp))
        assert len(join._waiting) <= capacity
        if items:
            assert items == (('a', stamp), ('b', stamp), ('c', stamp))
            complete.append(stamp)
    assert len(complete) + join.dropped + len(join._waiting) >= len(started)


@dataclass
class Picture:
    data: bytes


def test_pictures_wait_for_a_stage_that_takes_long_while_there_is_room():
    """60 Hz, and the flow of every 30th picture comes half a second later; twelve sets may wait whatever their size."""
    join, joined = ExactJoin(('image', 'flow'), 12, size=size_of), []
    for index in range(300):
        join.add('image', index, Picture(bytes(1 << 20)))
        if index >= 30 and index % 30 == 0:
            joined.append(join.add('flow', index - 30, Picture(b'')))
    assert len(joined) == 9 and all(joined)
    assert join.dropped == 240 - 8  # what lies before the last set that is complete, the other complete ones aside


def test_of_large_pictures_no_more_wait_than_there_is_room_for():
    join, count = ExactJoin(('image', 'flow'), 3, size=size_of), 20
    for index in range(count):
        join.add('image', index, Picture(bytes(ROOM_BYTES // 8)))
    assert len(join._waiting) == 8
    assert join.add('flow', 12, Picture(b'')) is not None
    for index in range(count, 2 * count):
        join.add('image', index, Picture(bytes(ROOM_BYTES)))
    assert len(join._waiting) == 3
    assert join.dropped == 2 * count - 3 - 1


def test_small_pictures_are_counted():
    join = ExactJoin(('image', 'flow'), 3, size=size_of)
    for index in range(MOST_SETS + 50):
        join.add('image', index, Picture(b'1'))
    assert (len(join._waiting), join.dropped) == (MOST_SETS, 50)
    assert next(iter(join._waiting)) == 50


def test_worker_keeps_the_newest_and_counts_the_rest():
    gate, done, seen, dropped = threading.Event(), threading.Event(), [], []

    def handle(item: int) -> None:
        gate.wait(TIMEOUT_S)
        seen.append(item)
        if item == 9:
            done.set()

    worker = Worker(handle, 2, dropped.append)
    for item in range(10):
        worker.submit(item)
    gate.set()
    assert done.wait(TIMEOUT_S)
    worker.stop()
    assert seen[-2:] == [8, 9]
    assert len(seen) + sum(dropped) == 10


def until(condition: Callable[[], bool]) -> None:
    deadline = time.monotonic() + TIMEOUT_S
    while not condition():
        assert time.monotonic() < deadline
        time.sleep(0.001)


def worked_off(jumps: bool, items: int) -> tuple[list[int], int]:
    """What a worker with a mailbox of two made of ``items`` that came while it was busy with the first, and drops."""
    busy, gate, seen, dropped = threading.Event(), threading.Event(), [], []

    def handle(item: int) -> None:
        busy.set()
        gate.wait(TIMEOUT_S)
        seen.append(item)

    worker = Worker(handle, 2, dropped.append, jumps)
    worker.submit(0)
    assert busy.wait(TIMEOUT_S)
    for item in range(1, items):
        worker.submit(item)
    gate.set()
    until(lambda: len(seen) + sum(dropped) == items)
    worker.stop()
    return seen, sum(dropped)


def test_worker_that_jumps_takes_the_newest_once_it_is_late():
    assert worked_off(jumps=True, items=6) == ([0, 5], 4)
    assert worked_off(jumps=False, items=6) == ([0, 4, 5], 3)


def test_worker_that_jumps_works_off_a_burst_that_fits_the_mailbox():
    assert worked_off(jumps=True, items=3) == ([0, 1, 2], 0)


def test_worker_that_has_caught_up_takes_everything_again():
    gate, begun, seen = threading.Semaphore(0), [], []
    worker = Worker(lambda item: (begun.append(item), gate.acquire(timeout=TIMEOUT_S), seen.append(item)), 2,
                    lambda count: None, jumps=True)
    worker.submit(0)
    until(lambda: begun == [0])
    for item in range(1, 5):
        worker.submit(item)
    gate.release(2)
    until(lambda: seen == [0, 4] and not worker._late)
    worker.submit(10)
    until(lambda: begun[-1] == 10)
    for item in (11, 12):
        worker.submit(item)
    gate.release(3)
    until(lambda: len(seen) == 5)
    worker.stop()
    assert seen == [0, 4, 10, 11, 12]
