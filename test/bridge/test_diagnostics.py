"""The health of a node, against counts and times made by hand."""

from __future__ import annotations

import math
import threading

import pytest
from builtin_interfaces.msg import Time
from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus

from motion_detect_ros.bridge.diagnostics import Condition, Reporter, StageStats, Summary

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


def status(
    stats: StageStats, now_s: float, extra: tuple[tuple[str, str], ...] = (), condition: Condition | None = None,
    reporter: Reporter | None = None,
) -> DiagnosticStatus:
    reporter = reporter or Reporter('/front/flow', 'flow', stats)
    message = reporter.report(round(now_s * SECOND), condition or Condition(), Time(sec=3, nanosec=4), extra)
    assert isinstance(message, DiagnosticArray)
    assert message.header.stamp == Time(sec=3, nanosec=4)
    assert len(message.status) == 1
    return message.status[0]


def flowing(seconds: float, hz: float = 10.0) -> StageStats:
    """Inputs and outputs at a steady rate from 0 s on."""
    stats = StageStats()
    for index in range(round(seconds * hz) + 1):
        stats.count_received(round(index * SECOND / hz))
        stats.count_processed(round(index * SECOND / hz), 1.0, 1.0)
    return stats


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
    empty = status(StageStats(), 0.0)
    assert (empty.level, empty.message) == (DiagnosticStatus.WARN, 'nothing received yet')
    stats = flowing(1.0)
    assert (status(stats, 1.0).level, status(stats, 1.0).message) == (DiagnosticStatus.OK, '10.0 Hz')
    silent = status(stats, 6.0)
    assert (silent.level, silent.message) == (DiagnosticStatus.WARN, 'nothing received for 5 s')


def test_slow_sources_are_not_silent_between_two_pictures():
    stats = flowing(20.0, 0.2)
    assert status(stats, 34.0).level == DiagnosticStatus.OK
    assert status(stats, 36.0).message == 'nothing received for 16 s'


def test_drops_warn_in_the_report_after_them_and_not_for_ever():
    stats = flowing(5.0)
    reporter = Reporter('/front/flow', 'flow', stats)
    stats.count_dropped(3)
    first, second = (status(stats, 5.0, reporter=reporter) for _ in range(2))
    assert (first.level, first.message) == (DiagnosticStatus.WARN, '3 dropped since the last report')
    assert second.level == DiagnosticStatus.OK
    stats.count_dropped()
    again = status(stats, 5.0, reporter=reporter, condition=Condition(concern='lags'))
    assert (again.level, again.message) == (DiagnosticStatus.WARN, '1 dropped since the last report, lags')
    assert {pair.key: pair.value for pair in again.values}['dropped'] == '4'


class Overtaken(StageStats):
    """In the middle of the first summary two more frames are dropped and another thread reports."""

    def __init__(self, other: threading.Thread) -> None:
        super().__init__()
        self._other = other

    def summary(self, now_ns: int) -> Summary:
        found = super().summary(now_ns)
        if not self._other.ident:
            self.count_dropped(2)
            self._other.start()
            self._other.join(0.3)  # as far as it gets without this report being done
        return found


def test_each_drop_is_in_one_report_whichever_thread_makes_it():
    found: list[str] = []

    def report() -> None:
        found.append(reporter.report(0, Condition(), Time()).status[0].message)

    other = threading.Thread(target=report)
    stats = Overtaken(other)
    reporter = Reporter('/front/camera', 'camera', stats)
    stats.count_dropped(3)
    report()
    other.join()
    assert sorted(text.partition(',')[0] for text in found) == [
        '2 dropped since the last report', '3 dropped since the last report']


def test_a_fault_is_an_error_whatever_else():
    failed = status(flowing(1.0), 1.0, condition=Condition(fault='camera 0: gone', idle='inactive'))
    assert (failed.level, failed.message) == (DiagnosticStatus.ERROR, 'camera 0: gone')


def test_an_idle_node_neither_misses_inputs_nor_drops_but_errors_count():
    idle, stats = Condition(idle='no subscribers'), StageStats()
    stats.count_dropped()
    found = status(stats, 60.0, condition=idle)
    assert (found.level, found.message) == (DiagnosticStatus.OK, 'no subscribers')
    stats.count_error('bad', 59 * SECOND)
    assert status(stats, 60.0, condition=idle).level == DiagnosticStatus.WARN


def test_an_error_warns_for_a_while_and_not_for_ever():
    stats = StageStats()
    stats.count_error('image step: expected at least 6', 1 * SECOND)
    for index in range(300):
        stats.count_received(index * SECOND // 10)
    soon, later = status(stats, 3.9), status(stats, 4.1)
    assert (soon.level, soon.message) == (DiagnosticStatus.WARN, '1 errors, last: image step: expected at least 6')
    assert later.level == DiagnosticStatus.OK


def test_images_that_come_in_vain_are_a_warning_then_an_error_then_forgotten():
    stats = flowing(1.0)

    def comes(now_s: float, reason: str) -> DiagnosticStatus:
        stats.count_received(round(now_s * SECOND))
        stats.expect_use(round(now_s * SECOND))
        if reason:
            stats.count_unused(reason)
        else:
            stats.count_used()
        return status(stats, now_s)

    found = [comes(1.0 + index / 10, 'ego-motion is LOW_TEXTURE') for index in range(60)]
    assert found[19].level == DiagnosticStatus.OK
    assert [(each.level, each.message) for each in (found[26], found[56])] == [
        (DiagnosticStatus.WARN, 'no image could be used for 3 s: ego-motion is LOW_TEXTURE'),
        (DiagnosticStatus.ERROR, 'no image could be used for 6 s: ego-motion is LOW_TEXTURE')]
    assert comes(7.0, '').level == DiagnosticStatus.OK
    assert comes(7.1, 'stamps late').level == DiagnosticStatus.OK


def test_images_that_wait_for_another_topic_in_vain_name_it():
    stats = flowing(1.0)
    for index in range(11, 45):
        stats.count_received(index * SECOND // 10)
        stats.expect_use(index * SECOND // 10)
    found = status(stats, 4.4, condition=Condition(waits='nothing of the same stamp from flow'))
    assert (found.level, found.message) == (
        DiagnosticStatus.WARN, 'no image could be used for 3 s: nothing of the same stamp from flow')


def test_images_that_come_again_after_a_silence_begin_anew():
    stats = flowing(1.0)
    stats.expect_use(SECOND)
    for time_s in (60.0, 60.1):
        stats.count_received(round(time_s * SECOND))
        stats.expect_use(round(time_s * SECOND))
    assert stats.summary(round(60.1 * SECOND)).unused_s == pytest.approx(0.1)


def test_only_a_higher_level_is_worth_a_report_out_of_turn():
    stats = flowing(1.0)
    reporter = Reporter('/front/flow', 'flow', stats)
    assert not reporter.worse(SECOND, Condition(concern='lags'))  # the first report has its turn
    assert status(stats, 1.0, reporter=reporter).level == DiagnosticStatus.OK
    assert not reporter.worse(SECOND, Condition())
    assert reporter.worse(SECOND, Condition(concern='lags'))
    assert status(stats, 1.0, reporter=reporter, condition=Condition(concern='lags')).level == DiagnosticStatus.WARN
    assert not reporter.worse(SECOND, Condition(concern='lags'))
    assert not reporter.worse(SECOND, Condition())
    assert reporter.worse(SECOND, Condition(fault='gone'))


def test_without_frames_latency_is_unknown():
    assert math.isnan(StageStats().summary(0).latency_p50_ms)
