"""The measuring tools measure what they say: against sleeps, known power laws and known memory."""

from __future__ import annotations

import json
import math
import mmap
import os
import re
from argparse import Namespace
from types import SimpleNamespace

import cv2
import numpy as np
import pytest

from motion_detect_ros.benchmarks import bench, bench_curves, bench_report, bench_stages, bench_timing
from motion_detect_ros.benchmarks.bench_curves import slope
from motion_detect_ros.core.config import PipelineConfig
from motion_detect_ros.core.errors import ConfigError, SourceError
from motion_detect_ros.core.types import StageTimes
from motion_detect_ros.sources.synthetic import FlightConfig


def test_percentiles_of_known_values():
    row = bench_timing.Timing.of('x', [float(value) for value in range(101)] + [math.nan])
    assert (row.p50, row.p95, row.p99) == (50.0, 95.0, 99.0)
    assert math.isnan(bench_timing.Timing.of('x', []).p50)


def test_interleaved_takes_turns_and_times_each():
    """By a clock that only the steps move: a takes 4 ms and one more each frame, b always 1 ms."""
    calls, now_s = [], 100.0

    def step(name: str, milliseconds: list[float]):
        def work(index: int) -> None:
            nonlocal now_s
            calls.append((index, name))
            now_s += 1e-3 * milliseconds[index]
        return work

    steps = [step('a', [4.0, 5.0, 6.0, 7.0, 8.0, 9.0]), step('b', [1.0] * 6)]
    times = bench_timing.interleaved(steps, 6, warm_frames=2, clock=lambda: now_s)
    assert calls[:6] == [(0, 'a'), (0, 'b'), (1, 'b'), (1, 'a'), (2, 'a'), (2, 'b')]
    np.testing.assert_allclose(times, [[6.0, 1.0], [7.0, 1.0], [8.0, 1.0], [9.0, 1.0]], atol=1e-6)


def test_ratio_is_the_median_of_ratios_so_that_a_loaded_moment_does_not_count():
    times = np.array([[3.0, 2.0], [30.0, 20.0], [300.0, 2.0]])
    assert bench_timing.Ratio.of('x', times) == bench_timing.Ratio('x', 30.0, 2.0, 1.5)


def test_floor_runs_the_calls_it_names(monkeypatch: pytest.MonkeyPatch):
    frames = bench_timing.flight(FlightConfig(width=320, height=180, frames=3))
    counts = dict.fromkeys(('goodFeaturesToTrack', 'calcOpticalFlowPyrLK', 'cvtColor'), 0)

    def counting(name: str):
        real = getattr(cv2, name)

        def call(*args, **options):
            counts[name] += 1
            return real(*args, **options)
        return call

    for name in counts:
        monkeypatch.setattr(cv2, name, counting(name))
    floor = bench_timing.OpenCvFloor(PipelineConfig(), frames, [np.eye(3)] * 3)
    for index in range(3):
        floor.step(index)
    assert counts == {'goodFeaturesToTrack': 2, 'calcOpticalFlowPyrLK': 4, 'cvtColor': 3}


@pytest.mark.parametrize('exponent', [-0.5, 0.0, 1.0, 2.0])
def test_slope_of_a_power_law(exponent: float):
    x = [0.0, 1.0, 3.0, 10.0, 50.0]
    assert slope(x, [9.0, *(7.0 * value ** exponent for value in x[1:])]) == pytest.approx(exponent, abs=0.005)
    assert math.isnan(slope([0.0, 2.0], [1.0, 1.0]))


def test_as_many_cars_as_asked_for_none_on_another():
    for count in (0, 5, 25, 200):
        cars = bench_curves.cars(count)
        assert len(cars) == count
        places = {(round(car.x_m, 3), round(car.y_m, 3)) for car in cars}
        assert len(places) == count
        assert all(abs(car.x_m) < 50.0 and abs(car.y_m) < 28.0 for car in cars)


def test_parts_are_chosen_by_name():
    assert bench.chosen('floor, stages') == ['stages', 'floor']
    assert bench.chosen(None) == list(bench.PARTS)
    assert not set(bench.chosen(None, no_nodes=True)) & set(bench.NODE_PARTS)
    with pytest.raises(ConfigError, match=r"--parts: expected some of stages, .*, got 'flor'"):
        bench.chosen('flor')
    with pytest.raises(ConfigError, match='--frames: expected 10 or more, got 3'):
        bench.run(Namespace(frames=3))


def test_every_part_has_a_section():
    assert {*bench.PARTS, 'soak'} == set(bench_report.SECTIONS) == set(bench_report.ABOUT)


def test_document_and_json_hold_what_was_measured(tmp_path, capsys):
    arguments = Namespace(preset='default', frames=10, parts='codec', no_nodes=True, soak=[],
                          json=tmp_path / 'figures.json', markdown=tmp_path / 'figures.md')
    assert bench.run(arguments) == 0
    figures = json.loads((tmp_path / 'figures.json').read_text())
    text = (tmp_path / 'figures.md').read_text()
    assert text.strip() == capsys.readouterr().out.strip()
    assert set(figures) == {'machine', 'preset', 'frames', 'codec'}
    assert re.search(rf'\| to message \| {figures["codec"][0]["p50"]:.2f} \|', text)
    assert '## Memory' not in text
    figures['memory'] = {'early_frames': 100, 'early_mb': 250.0, 'frames': 600, 'mb': 251.0}
    arguments.json.write_text(json.dumps(figures))
    assert bench.run(arguments) == 0
    assert '| 600 | 251 | 400 |' in arguments.markdown.read_text()
    arguments.json.write_text('no figures')
    with pytest.raises(ConfigError, match=r'figures\.json: expected figures of an earlier run'):
        bench.run(arguments)


def test_a_long_run_is_put_into_the_document_and_stays(tmp_path):
    summary = {'pictures': 'a clip', 'preset': 'visdrone', 'minutes': 30.0, 'sent': 36000, 'answered': 35990,
               'dropped': 8, 'lost': 2, 'memory_first_mb': 337.0, 'memory_last_mb': 337.4, 'growth_mb_per_hour': 0.9,
               'latency_p50_ms': 31.25, 'latency_p95_ms': 40.0}
    (tmp_path / 'summary.json').write_text(json.dumps(summary))
    arguments = Namespace(preset='default', frames=10, parts='codec', no_nodes=True,
                          soak=[tmp_path / 'summary.json'] * 2,
                          json=tmp_path / 'figures.json', markdown=tmp_path / 'figures.md')
    assert bench.run(arguments) == 0
    arguments.soak = []
    assert bench.run(arguments) == 0
    text = arguments.markdown.read_text()
    assert text.count('| a clip | visdrone | 30 | 36000 | 35990 | 8 | 2 | 337.0 to 337.4 | 0.9 | 31.2 | 40.0 |') == 2
    arguments.soak = [tmp_path / 'none.json']
    with pytest.raises(ConfigError, match=r'none\.json: figures cannot be read: No such file'):
        bench.run(arguments)


def test_graphs_are_held_against_the_goal_of_their_kind():
    timing = {'name': 'pipeline', 'p50': 30.0, 'p95': 40.0, 'p99': 50.0}
    row = {'timing': timing, 'rate_hz': 20.0, 'compute_ms': 25.0, 'beyond_ms': 5.0, 'images': 300, 'lost': 7}
    adapting = {**row, 'timing': {**timing, 'name': 'pipeline, load.adapt'}}
    text = bench_report.markdown({'machine': bench_report.machine(), 'transport_clip': [row, adapting]})
    figures = '20 | 30.0 | 40.0 | 50.0 | 25.0 | 5.0 | 6 | 7 of 300 |'
    assert f'| pipeline | {figures}' in text and f'| pipeline, load.adapt | {figures}' in text


def test_stage_table_adds_up(monkeypatch: pytest.MonkeyPatch):
    times = StageTimes(1.0, 2.0, 4.0, 8.0)
    monkeypatch.setattr(bench_stages.MotionPipeline, 'process', lambda *_: SimpleNamespace(times_ms=times))
    frames = [(None, stamp) for stamp in range(12)]
    rows = bench_stages.stage_times(PipelineConfig(), frames)
    assert {row.name: (row.p50, row.p95) for row in rows[:-1]} == {
        'preprocessing': (1.0, 1.0), 'ego_motion': (2.0, 2.0), 'optical_flow': (4.0, 4.0), 'clustering': (8.0, 8.0),
        'total': (15.0, 15.0)}


def test_stage_table_of_a_flight():
    frames = bench_timing.flight(FlightConfig(width=320, height=180, frames=12))
    rows = {row.name: row for row in bench_stages.stage_times(PipelineConfig(), frames)}
    assert list(rows) == ['preprocessing', 'ego_motion', 'optical_flow', 'clustering', 'total', 'processor']
    stages = sum(rows[name].p50 for name in ('preprocessing', 'ego_motion', 'optical_flow', 'clustering'))
    assert 0.2 * rows['total'].p50 < stages < 1.1 * rows['total'].p95  # medians, of a machine that others use
    assert 0.0 < rows['processor'].p50 <= 1.1 * os.cpu_count() * rows['total'].p95


def test_memory_of_a_process_grows_by_what_it_takes():
    nodes = pytest.importorskip('motion_detect_ros.benchmarks.bench_nodes')
    before = nodes.resident_mb(os.getpid())
    with mmap.mmap(-1, 50 * 2 ** 20) as block:  # pages of its own, not what the allocator has left over
        block.write(b'x' * len(block))
        assert nodes.resident_mb(os.getpid()) - before >= 45.0
    with pytest.raises(SourceError, match='expected /proc/999999999/status'):
        nodes.resident_mb(999999999)
