"""The pipeline must not get slower against the OpenCV calls that it cannot do without.

Absolute times say little on a shared machine. Both sides take turns frame by frame here, and the median of the ratios
is held against the one on record. After a change that is worth its price, record the new one:

    python test/benchmarks/test_bench_guard.py
"""

from __future__ import annotations

import json
import time
from pathlib import Path

import numpy as np
import pytest

from motion_detect_ros.benchmarks.bench_timing import flight, floor_times
from motion_detect_ros.core.config import PipelineConfig
from motion_detect_ros.core.pipeline import MotionPipeline, warm_up
from motion_detect_ros.core.preprocessing.stage import Preprocessor
from motion_detect_ros.sources.synthetic import FlightConfig

pytestmark = pytest.mark.timing

RECORD = Path(__file__).with_name('bench_guard.json')
FLIGHT = FlightConfig(width=640, height=360, frames=35)
GROWTH = 1.25
ATTEMPTS = 2


def ratio() -> float:
    """Time of the pipeline over time of the floor, median over the frames."""
    times = floor_times(PipelineConfig(), flight(FLIGHT))
    return float(np.median(times[:, 0] / times[:, 1]))


def lowest(allowed: float) -> float:
    """Measured again before it is believed."""
    found = []
    while len(found) < ATTEMPTS and min(found, default=np.inf) > allowed:
        found.append(ratio())
    return min(found)


def test_pipeline_against_the_opencv_floor():
    warm_up(PipelineConfig())
    recorded = json.loads(RECORD.read_text())['pipeline_to_floor']
    assert lowest(GROWTH * recorded) <= GROWTH * recorded


def test_guard_sees_a_pipeline_that_has_become_slower(monkeypatch: pytest.MonkeyPatch):
    warm_up(PipelineConfig())
    recorded = json.loads(RECORD.read_text())['pipeline_to_floor']
    base = _pipeline_ms()
    prepare = Preprocessor.process

    def slow(self, image, stamp_ns):
        deadline = time.perf_counter() + 0.5e-3 * base
        while time.perf_counter() < deadline:
            pass
        return prepare(self, image, stamp_ns)

    monkeypatch.setattr(Preprocessor, 'process', slow)
    assert lowest(GROWTH * recorded) > GROWTH * recorded


def _pipeline_ms() -> float:
    pipeline = MotionPipeline(PipelineConfig())
    return float(np.median([pipeline.process(*frame).times_ms.total for frame in flight(FLIGHT)[:15]]))


if __name__ == '__main__':
    warm_up(PipelineConfig())
    RECORD.write_text(json.dumps({'pipeline_to_floor': round(float(np.median([ratio() for _ in range(3)])), 3)}) + '\n')
    print(RECORD.read_text())
