"""The same scene at another frame rate or working resolution is judged alike."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from motion_detect_ros.core.config import PipelineConfig, PreprocessingConfig
from motion_detect_ros.core.detection.detector import MotionDetector
from motion_detect_ros.core.pipeline import MotionPipeline
from motion_detect_ros.sources.synthetic import FlightConfig, SyntheticFlight

#: Length of the flights, seconds; the object of 60 px moves by 80 px a second, the camera by 40.
SECONDS = 2.0
FLIGHT = FlightConfig.single(60.0, 4.0, 2.0, direction_deg=30.0, frames=41)


def seen(rate_hz: float) -> tuple[list[float], list[float]]:
    """Times, seconds, of the frames in which one object is reported, and its scores there."""
    flight = SyntheticFlight(replace(FLIGHT, fps=rate_hz, frames=round(SECONDS * rate_hz) + 1))
    pipeline, times, scores = MotionPipeline(), [], []
    for frame in flight:
        found = pipeline.process(frame.image, frame.stamp_ns).detections
        if len(found) == 1:
            times.append((frame.stamp_ns - FLIGHT.start_stamp_ns) / 1e9)
            scores.append(float(found['score'][0]))
    return times, scores


def test_ten_twenty_and_forty_hertz_report_alike() -> None:
    first, share = [], []
    for rate_hz in (10.0, 20.0, 40.0):
        times, scores = seen(rate_hz)
        first.append(times[0])
        share.append(len([time for time in times if time > 0.5]) / ((SECONDS - 0.5) * rate_hz))
        assert np.median(scores) > 0.9
    assert max(first) - min(first) <= 0.15 and max(first) < 0.5
    assert min(share) > 0.9


def test_log_odds_do_not_grow_with_the_working_resolution(monkeypatch: pytest.MonkeyPatch) -> None:
    """One object of 120 px in a picture of 1920 px, worked on at half, full and double the default width."""
    flight = SyntheticFlight(replace(
        FLIGHT, width=1920, height=1080, focal_px=1440.0, frames=16,
        objects=tuple(replace(each, x_m=0.0, y_m=0.0) for each in FLIGHT.objects)))
    frames = list(flight)
    candidates = MotionDetector.candidates
    found: list[list[float]] = []

    def noted(*arguments: object) -> object:
        made = candidates(*arguments)  # type: ignore[arg-type]
        found[-1] += [max(each.log_odds for each in made)] if made else []
        return made

    monkeypatch.setattr(MotionDetector, 'candidates', noted)
    for width in (480, 960, 1920):
        pipeline = MotionPipeline(replace(PipelineConfig(), preprocessing=PreprocessingConfig(max_width_px=width)))
        found.append([])
        for frame in frames:
            pipeline.process(frame.image, frame.stamp_ns)
    assert all(len(each) >= 10 for each in found)
    medians = [float(np.median(each)) for each in found]
    assert max(medians) - min(medians) < 1.5, medians
