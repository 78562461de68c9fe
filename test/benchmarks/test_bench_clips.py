"""Costs on real clips: here a drawn one under the name of a real one."""

from __future__ import annotations

import json
from pathlib import Path

import cv2
import numpy as np
import pytest

from motion_detect_ros.benchmarks import bench_clips, bench_report
from motion_detect_ros.benchmarks.accuracy_clips import DATA_VARIABLE
from motion_detect_ros.benchmarks.plain_methods import DIFFERENCE
from motion_detect_ros.core.threads import limited
from motion_detect_ros.sources.synthetic import FlightConfig, SyntheticFlight

FRAMES = 4


@pytest.fixture
def data(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    folder = tmp_path / 'frames'
    folder.mkdir()
    for frame in SyntheticFlight(FlightConfig(width=320, height=180, frames=bench_clips.WARM_FRAMES + FRAMES)):
        cv2.imwrite(str(folder / f'{frame.index:06d}.png'), frame.image)
    entry = {'frames': 'frames', 'gt': 'gt.txt', 'fps': 20, 'preset': 'visdrone'}
    (tmp_path / 'clips.json').write_text(json.dumps({bench_clips.CLIPS[0]: entry, 'another': entry}))
    monkeypatch.setenv(DATA_VARIABLE, str(tmp_path))
    return tmp_path


def test_every_way_is_measured_on_the_clips_that_are_there(data: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    widths = []
    process = bench_clips.MotionPipeline.process

    def noted(self: bench_clips.MotionPipeline, image: np.ndarray, stamp_ns: int) -> object:
        result = process(self, image, stamp_ns)
        widths.append((cv2.getNumThreads(), self._preprocessor._max_width_px))
        return result

    monkeypatch.setattr(bench_clips, 'warm_up', lambda _: None)
    monkeypatch.setattr(bench_clips.MotionPipeline, 'process', noted)
    before = cv2.getNumThreads()
    with limited(0):
        threads = cv2.getNumThreads()
    (found,) = bench_clips.clip_costs(FRAMES)
    assert (found['clip'], found['size']) == (bench_clips.CLIPS[0], '320x180')
    names = [row['name'] for row in found['rows']]
    assert {'ours', DIFFERENCE, 'ours, one thread', 'ours, 75% of the width', 'ours, 50% of the width'} <= set(names)
    assert all(0.0 < row['p50'] <= row['p95'] and row['mean'] <= row['ready'] for row in found['rows'])
    assert all(row['processor'] > 0.0 for row in found['rows'])
    each = bench_clips.WARM_FRAMES + FRAMES
    assert widths == [(threads, 960)] * each + [(1, 960)] * each + [(threads, 720)] * each + [(threads, 480)] * each
    assert cv2.getNumThreads() == before
    text = bench_report.markdown({'machine': bench_report.machine(), 'clips': [found]})
    assert f'| `{bench_clips.CLIPS[0]}`, 320x180 | ours |' in text


def test_without_clips_the_document_says_so(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv(DATA_VARIABLE, str(tmp_path))
    assert bench_clips.clip_costs(FRAMES) == []
    assert 'no clips' in bench_report.markdown({'machine': bench_report.machine(), 'clips': []})
