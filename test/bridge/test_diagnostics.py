"""What a node says about itself, against counts and times made by hand."""

from __future__ import annotations

import math
import threading

import pytest
from builtin_interfaces.msg import Time
from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus

from motion_detect_ros.bridge.diagnostics import StageStats, to_diagnostics

SECOND = 1_000_000_000


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


def test_rates_fall_when_nothing_comes_any_more():
    stats = StageStats()
    for index in range(11):
        stats.count_received(index * SECOND // 10)
    assert stats.summary(SECOND).rate_in_hz == pytest.approx(10.0)
    assert stats.summary(5 * SECOND).rate_in_hz == pytest.approx(2.0)


def test_no_count_is_lost_between_threads():
    stats = StageStats()

    def count() -> None:
        for index in range(2000):
            stats.count_received(index)
            stats.count_processed(index, 1.0, 1.0)
            stats.count_dropped(2)
            stats.count_error('bad', index)

    threads = [threading.Thread(target=count) for _ in range(4)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    summary = stats.summary(SECOND)
    assert (summary.received, summary.processed, summary.dropped, summary.errors) == (8000, 8000, 16000, 8000)


def status(stats: StageStats, now_s: float, extra: tuple[tuple[str, str], ...] = ()) -> DiagnosticStatus:
    message = to_diagnostics('/front/flow', 'flow', stats.summary(round(now_s * SECOND)), Time(sec=3, nanosec=4), extra)
    assert isinstance(message, DiagnosticArray)
    assert message.header.stamp == Time(sec=3, nanosec=4)
    assert len(message.status) == 1
    return message.status[0]


def test_status_names_its_node_and_carries_every_figure_as_text():
    stats = StageStats()
    stats.count_received(0)
    stats.count_processed(0, 12.5, 40.0)
    found = status(stats, 1.0, (('objects', '3'),))
    assert (found.name, found.hardware_id) == ('/front/flow', 'flow')
    values = {pair.key: pair.value for pair in found.values}
    assert (values['received'], values['latency_p50_ms'], values['stamp_age_ms'], values['objects']) == (
        '1', '12.500', '40.000', '3')
    assert (values['silent_s'], values['error_age_s'], values['last_error']) == ('1.000', 'inf', '')


def test_level_follows_what_happens():
    stats = StageStats()
    assert (status(stats, 0.0).level, status(stats, 0.0).message) == (DiagnosticStatus.WARN, 'nothing received yet')
    for index in range(11):
        stats.count_received(index * SECOND // 10)
        stats.count_processed(index * SECOND // 10, 1.0, 1.0)
    assert (status(stats, 1.0).level, status(stats, 1.0).message) == (DiagnosticStatus.OK, '10.0 Hz')
    silent = status(stats, 6.0)
    assert (silent.level, silent.message) == (DiagnosticStatus.WARN, 'nothing received for 5 s')


def test_an_error_warns_for_a_while_and_not_for_ever():
    stats = StageStats()
    stats.count_error('image step: expected at least 6', 1 * SECOND)
    for index in range(300):
        stats.count_received(index * SECOND // 10)
    soon, later = status(stats, 5.0), status(stats, 30.0)
    assert (soon.level, soon.message) == (DiagnosticStatus.WARN, '1 errors, last: image step: expected at least 6')
    assert later.level == DiagnosticStatus.OK


def test_without_frames_latency_is_unknown():
    assert math.isnan(StageStats().summary(0).latency_p50_ms)
