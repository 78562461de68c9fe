"""The verdict of a soak run, and a short one over the real node."""

from __future__ import annotations

import csv
import json
import os
from dataclasses import asdict, replace
from pathlib import Path

import numpy as np
import pytest

pytest.importorskip('rclpy')

from motion_detect_ros.benchmarks import soak
from motion_detect_ros.benchmarks.accuracy_clips import read_clips
from motion_detect_ros.benchmarks.soak import Sample, summarize

STEADY = [Sample(10.0 * (n + 1), 300.0, 80.0, 200, 200, 0, 0, 40.0, 50.0, 70.0, 35.0) for n in range(180)]


def test_steady_run():
    summary = summarize(STEADY, 20.0, 'x', 'default')
    assert summary.steady
    assert (summary.minutes, summary.sent, summary.answered) == (30.0, 36000, 36000)
    assert (summary.latency_p50_ms, summary.latency_p95_ms, summary.latency_max_ms) == (40.0, 50.0, 70.0)
    assert (summary.growth_mb, summary.growth_mb_per_hour) == (0.0, 0.0)


def test_leak_is_seen_and_measured():
    leaking = [replace(sample, memory_mb=300.0 + sample.seconds * 60.0 / 3600.0) for sample in STEADY]
    summary = summarize(leaking, 20.0, 'x', 'default')
    assert summary.growth_mb_per_hour == pytest.approx(60.0, abs=0.1)
    assert not summary.steady


def test_caches_that_fill_at_the_start_are_no_leak():
    filling = [replace(sample, memory_mb=300.0 - max(0.0, 300.0 - sample.seconds)) for sample in STEADY]
    assert summarize(filling, 20.0, 'x', 'default').steady


def test_lost_pictures_are_seen_dropped_ones_are_told_apart():
    assert not summarize([replace(sample, answered=190) for sample in STEADY], 20.0, 'x', 'default').steady
    dropping = summarize([replace(sample, answered=190, dropped=10) for sample in STEADY], 20.0, 'x', 'default')
    assert (dropping.steady, dropping.dropped, dropping.lost) == (True, 1800, 0)
    assert not summarize([], 20.0, 'x', 'default').steady


def test_wrong_use_is_one_line(capsys, tmp_path):
    assert soak.main(['--minutes', '0', '-o', str(tmp_path)]) == 2
    assert capsys.readouterr().err == 'error: --minutes, --rate: expected over 0, got 0, 20\n'


def test_real_pictures_that_are_not_there_are_one_line(capsys, tmp_path, monkeypatch):
    monkeypatch.setenv('MOTION_DETECT_DATA', str(tmp_path))
    assert soak.main(['--real', '-o', str(tmp_path / 'out')]) == 2
    assert capsys.readouterr().err == 'error: --real: expected real clips, found none; set MOTION_DETECT_DATA\n'


@pytest.mark.parametrize('more', [[], ['--faults', 'pipeline']])
def test_real_pictures_that_are_not_there_cost_no_earlier_run(more, tmp_path, monkeypatch):
    monkeypatch.setenv('MOTION_DETECT_DATA', str(tmp_path))
    (tmp_path / 'summary.json').write_text('of an earlier run')
    assert soak.main(['--real', '-o', str(tmp_path), '--minutes', '0.5', *more]) == 2
    assert (tmp_path / 'summary.json').read_text() == 'of an earlier run'


@pytest.mark.soak
@pytest.mark.skipif(not os.environ.get('SOAK_MINUTES'), reason='set SOAK_MINUTES for a long run')
def test_long_run_is_steady(tmp_path):
    minutes = float(os.environ['SOAK_MINUTES'])
    assert soak.soak(minutes, 'default', soak.RATE_HZ, tmp_path).steady


def short_run(folder: Path) -> tuple[soak.SoakSummary, list[dict[str, str]]]:
    """6 s at 5 pictures a second, a sample every 2 s: the summary and the samples on file."""
    summary = soak.soak(0.1, 'default', 5.0, folder, period_s=2.0)
    with (folder / 'samples.csv').open(encoding='utf-8') as file:
        return summary, list(csv.DictReader(file))


def test_short_run_over_the_real_node(tmp_path):
    summary, rows = short_run(tmp_path)
    assert json.loads((tmp_path / 'summary.json').read_text()) == asdict(summary)
    for name in ('sent', 'answered', 'dropped', 'errors'):
        assert sum(int(row[name]) for row in rows) == getattr(summary, name)
    assert (summary.sent > 0, summary.answered > 0, summary.errors) == (True, True, 0)
    assert min(float(row['memory_mb']) for row in rows) > 50.0
    assert summary.latency_p50_ms > 0.0


def test_pictures_of_a_real_clip_in_a_loop(tmp_path, clips, monkeypatch):
    shown, feeder = [], soak.Feeder
    monkeypatch.setattr(soak, 'Feeder', lambda domain, images, hz: shown.extend(images) or feeder(domain, images, hz))
    clip = read_clips(clips)[0]
    summary = soak.soak(0.1, clip.preset, 5.0, tmp_path, period_s=2.0, clip=clip)
    assert (summary.pictures, summary.preset) == (clip.name, clip.preset)
    assert summary.answered > 0 and summary.errors == 0
    for picture, frame in zip(shown[:3], clip.source(), strict=False):
        assert np.array_equal(picture, frame.image)


@pytest.mark.timing
def test_short_run_sends_at_its_rate_and_is_answered(tmp_path):
    summary, rows = short_run(tmp_path)
    assert len(rows) == 3
    assert min(float(row['latency_p50_ms']) for row in rows) > 0.0
    assert summary.sent == pytest.approx(30, abs=3)
    assert summary.answered >= summary.sent - 2
