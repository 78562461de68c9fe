"""The pipeline must not get slower against the OpenCV calls that it cannot do without.

Absolute times say little on a shared machine. Both sides take turns frame by frame here, over a stretch of the built-in
town with about thirty movers in the picture, and what counts is processor time of all threads, which other load hardly
changes; the ratio of the sums, as not all frames cost the same, is held against the one on record. After a change that
is worth its price, record the new one:

    python test/benchmarks/test_bench_guard.py
"""

from __future__ import annotations

import json
import time
from pathlib import Path

import numpy as np
import pytest

from motion_detect_ros.benchmarks.bench_timing import flight, floor_times
from motion_detect_ros.core.pipeline import MotionPipeline, warm_up
from motion_detect_ros.core.preprocessing.stage import Preprocessor
from motion_detect_ros.presets import load_preset
from motion_detect_ros.sources.synthetic import FlightConfig, SyntheticFlight

pytestmark = pytest.mark.timing

RECORD = Path(__file__).with_name('bench_guard.json')
FLIGHT = FlightConfig(width=640, height=360, frames=35, cars=200, people=500)
PRESETS = 'default', 'visdrone'
GROWTH = 1.25
ATTEMPTS = 2


def ratio(preset: str) -> float:
    """Processor time of the pipeline over that of the floor."""
    pipeline, floor = floor_times(load_preset(preset), flight(FLIGHT), time.process_time).sum(axis=0)
    return float(pipeline / floor)


def lowest(preset: str, allowed: float) -> float:
    """Measured again before it is believed."""
    found = []
    while len(found) < ATTEMPTS and min(found, default=np.inf) > allowed:
        found.append(ratio(preset))
    return min(found)


def recorded(preset: str) -> float:
    return json.loads(RECORD.read_text())['pipeline_to_floor'][preset]


def test_the_stretch_shows_about_thirty_movers():
    movers = [int((frame.truth['moving'] == 1).sum()) for frame in SyntheticFlight(FLIGHT)]
    assert 20 <= np.mean(movers) <= 40, np.mean(movers)


@pytest.mark.parametrize('preset', PRESETS)
def test_pipeline_against_the_opencv_floor(preset: str):
    warm_up(load_preset(preset))
    allowed = GROWTH * recorded(preset)
    assert lowest(preset, allowed) <= allowed


def test_guard_sees_a_pipeline_that_has_become_slower(monkeypatch: pytest.MonkeyPatch):
    config = load_preset('default')
    warm_up(config)
    pipeline, prepare = MotionPipeline(config), Preprocessor.process
    start = time.process_time()
    for frame in flight(FLIGHT)[:15]:
        pipeline.process(*frame)
    extra_s = 0.5 * (time.process_time() - start) / 15

    def slow(self, image, stamp_ns):
        end = time.thread_time() + extra_s
        while time.thread_time() < end:
            pass
        return prepare(self, image, stamp_ns)

    monkeypatch.setattr(Preprocessor, 'process', slow)
    allowed = GROWTH * recorded('default')
    assert lowest('default', allowed) > allowed


if __name__ == '__main__':
    for name in PRESETS:
        warm_up(load_preset(name))
    found = {name: round(float(np.median([ratio(name) for _ in range(3)])), 3) for name in PRESETS}
    RECORD.write_text(json.dumps({'pipeline_to_floor': found}) + '\n')
    print(RECORD.read_text())
