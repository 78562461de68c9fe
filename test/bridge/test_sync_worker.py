"""The join of inputs, and the worker's mailbox."""

from __future__ import annotations

import threading

from hypothesis import given
from hypothesis import strategies as st

from motion_detect_ros.bridge.diagnostics import StageStats
from motion_detect_ros.bridge.sync import ExactJoin
from motion_detect_ros.bridge.worker import Worker


def test_joins_by_equal_stamps_in_the_order_of_the_names():
    join = ExactJoin(('image', 'flow'), 4)
    assert join.add('flow', 10, 'f10') is None
    assert join.add('image', 11, 'i11') is None
    assert join.add('image', 10, 'i10') == ('i10', 'f10')
    assert join.add('flow', 11, 'f11') == ('i11', 'f11')
    assert join.dropped == 0


def test_older_incomplete_sets_are_dropped_and_counted():
    join = ExactJoin(('image', 'flow'), 4)
    join.add('image', 1, 'i1')
    join.add('image', 2, 'i2')
    assert join.add('flow', 2, 'f2') == ('i2', 'f2')
    assert join.dropped == 1
    assert join.add('flow', 1, 'f1') is None


@given(st.lists(st.tuples(st.sampled_from('abc'), st.integers(0, 12)), max_size=200), st.integers(1, 6))
def test_memory_is_bounded_and_nothing_is_lost_uncounted(inputs, capacity):
    join, complete, open_sets = ExactJoin(('a', 'b', 'c'), capacity), [], 0
    started = set()
    for name, stamp in inputs:
        started.add(stamp)
        items = join.add(name, stamp, (name, stamp))
        assert len(join._waiting) <= capacity
        if items:
            assert items == (('a', stamp), ('b', stamp), ('c', stamp))
            complete.append(stamp)
    open_sets = len(join._waiting)
    assert len(complete) + join.dropped + open_sets >= len(started)


def test_worker_keeps_the_newest_and_counts_the_rest():
    gate, done, seen, dropped = threading.Event(), threading.Event(), [], []

    def handle(item: int) -> None:
        gate.wait(5.0)
        seen.append(item)
        if item == 9:
            done.set()

    worker = Worker(handle, 2, dropped.append)
    for item in range(10):
        worker.submit(item)
    gate.set()
    assert done.wait(5.0)
    worker.stop()
    assert seen[-2:] == [8, 9]
    assert len(seen) + sum(dropped) == 10


def test_stats_count_rates_and_percentiles():
    stats = StageStats()
    for index in range(11):
        stats.count_received(index * 100_000_000)
        stats.count_processed(index * 100_000_000, float(index), 7.0)
    stats.count_dropped(3)
    stats.count_error('bad')
    summary = stats.summary(1_000_000_000)
    assert (summary.received, summary.processed, summary.dropped, summary.errors) == (11, 11, 3, 1)
    assert abs(summary.rate_in_hz - 10.0) < 1e-9
    assert (summary.latency_p50_ms, summary.last_error) == (5.0, 'bad')
    assert summary.latency_p95_ms == 9.5
    assert StageStats().summary(0).rate_in_hz == 0.0
