"""The clock of the machine is set while a camera runs: an hour ahead, an hour back."""

from __future__ import annotations

import time
from collections.abc import Iterator
from itertools import pairwise
from pathlib import Path

import pytest
from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus
from peers import small
from sensor_msgs.msg import Image, PointCloud2
from test_camera_lifecycle import stream  # noqa: F401 a fixture
from transport_files import set_back_checks

from motion_detect_ros.bridge.images import stamp_ns

pytestmark = pytest.mark.messages

FAKETIME = sorted(Path('/usr/lib').glob('*/faketime/libfaketimeMT.so.1'))
HOUR_S, HOUR_NS = 3600, 3_600_000_000_000
#: libfaketime does not convert the deadlines of pthread_mutex_timedlock: with a clock behind the real one, every lock
#: of Fast DDS that has to wait times out at once, and its shared memory is replaced over and over, which it may not
#: survive. So this clock is always ahead.
AHEAD_S = 2 * HOUR_S


@pytest.fixture
def own_clock() -> Iterator[None]:
    """What processes with a clock of their own leave behind in shared memory does no harm to others."""
    yield
    set_back_checks()


@pytest.mark.skipif(not FAKETIME, reason='no libfaketime: apt install libfaketime')
def test_a_clock_that_is_set_costs_no_more_than_history(
        own_clock, peer, start, stream, tmp_path, monkeypatch, shown):  # noqa: F811
    clock = tmp_path / 'clock'
    clock.write_text(f'{AHEAD_S:+d}')
    for name, value in {'LD_PRELOAD': FAKETIME[0], 'FAKETIME_TIMESTAMP_FILE': clock, 'FAKETIME_CACHE_DURATION': 1,
                        'FAKETIME_DONT_FAKE_MONOTONIC': 1}.items():
        monkeypatch.setenv(name, str(value))
    images, answers = peer.subscribe(Image, 'image_raw'), peer.subscribe(PointCloud2, 'detections')
    reports = peer.subscribe(DiagnosticArray, '/diagnostics')
    start('pipeline', *small())
    start('camera', '-p', f'source:={stream.address}', '-p', 'decimation_of:=5')
    monkeypatch.delenv('LD_PRELOAD')
    assert peer.until(lambda: len(answers) > 5)

    def answered_at(shift_s: int) -> bool:
        return abs(stamp_ns(answers[-1].header) - time.time_ns() - shift_s * 1_000_000_000) < HOUR_NS / 2

    assert answered_at(AHEAD_S)
    for shift_s in (AHEAD_S + HOUR_S, AHEAD_S, AHEAD_S - HOUR_S):
        clock.write_text(f'{shift_s:+d}')
        assert peer.until(lambda shift_s=shift_s: answered_at(shift_s)), shift_s
        seen = len(answers)
        assert peer.until(lambda seen=seen: len(answers) > seen + 10)
    reports.clear()
    assert peer.until(lambda: {status.name for report in reports for status in report.status
                               if status.level == DiagnosticStatus.OK} == {'/camera', '/pipeline'})
    stamps = [stamp_ns(message.header) for message in answers]
    back = [earlier - later for earlier, later in pairwise(stamps) if later <= earlier]
    assert len(back) == 2, 'they go back where the clock does, nowhere else'
    assert min(back) > HOUR_NS / 2
    assert len(images) > len(answers) / 2
    shown('the clock of the machine is set 1 h ahead, and back, and back again, under a live camera',
          'pictures and answers go on, diagnostics are OK again, stamps go back with the clock only',
          f'{len(answers)} answers')
