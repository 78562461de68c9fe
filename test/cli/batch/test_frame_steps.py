"""The steps of a replay, some frames ahead of each other."""

from __future__ import annotations

import threading
import time
import weakref
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest

from motion_detect_ros.cli.batch.frame_steps import frames_done
from motion_detect_ros.cli.batch.jobs import Job
from motion_detect_ros.core.config import PipelineConfig
from motion_detect_ros.core.pipeline import Measured, MotionPipeline
from motion_detect_ros.core.threads import limited
from motion_detect_ros.core.types import Result
from motion_detect_ros.presets import load_preset
from motion_detect_ros.results.tally import Tally
from motion_detect_ros.sources.ahead import DEPTH
from motion_detect_ros.sources.frames import SourceFrame
from motion_detect_ros.sources.synthetic import FlightConfig, SyntheticFlight

FRAMES = 24


class Pictures:
    """A source that knows which of its pictures somebody still holds; ``bad``: number of one that is no picture."""

    def __init__(self, bad: int | None = None) -> None:
        self.given, self._bad = list[weakref.ref[np.ndarray]](), bad

    def __iter__(self) -> Iterator[SourceFrame]:
        random = np.random.default_rng(1)
        for index in range(FRAMES):
            picture = random.integers(0, 256, (60, 80, 3), np.uint8)
            if index == self._bad:
                picture = picture[:, :, :2].copy()
            self.given.append(weakref.ref(picture))
            yield SourceFrame(index, picture, (index + 1) * 40_000_000)
            del picture

    @property
    def held(self) -> int:
        return sum(each() is not None for each in self.given)


@pytest.mark.parametrize('overlay', [False, True])
def test_pictures_are_let_go_once_they_are_measured_unless_they_are_written(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path, overlay: bool,
) -> None:
    """Large ones would fill the memory of a companion computer: six steps hold up to three frames each."""
    detect, source, held = MotionPipeline.detect, Pictures(), list[int]()

    def slow(self: MotionPipeline, measured: Measured) -> Result:
        time.sleep(0.05)  # so that all steps before wait
        held.append(source.held)
        return detect(self, measured)

    monkeypatch.setattr(MotionPipeline, 'detect', slow)
    job = Job('pictures', tmp_path, PipelineConfig(), overlay=overlay)
    with frames_done(job, source, MotionPipeline(), None, Tally()) as frames:  # type: ignore[arg-type]
        assert [done.frame.image is not None for done in frames] == [overlay] * FRAMES
    read = DEPTH + 3  # by the reader, before the step that measures, and there
    assert (max(held) > read) == overlay


@pytest.mark.parametrize('preset', ['default', 'visdrone'])
def test_what_is_done_is_what_one_frame_after_the_other_gives(tmp_path: Path, preset: str) -> None:
    """Points are followed beside the objects of the frames before (preset visdrone)."""
    config = load_preset(preset)
    pictures = SyntheticFlight(FlightConfig(width=480, height=270, focal_px=360.0, frames=36))
    flight = [SourceFrame(index, frame.image, frame.stamp_ns) for index, frame in enumerate(pictures)]
    with limited(2):
        pipeline = MotionPipeline(config)
        expected = [pipeline.process(frame.image, frame.stamp_ns).detections.tobytes() for frame in flight]
        with frames_done(  # type: ignore[arg-type]
                Job('flight', tmp_path, config), flight, MotionPipeline(config), None, Tally()) as frames:
            done = [frame.result.detections.tobytes() for frame in frames]
    assert done == expected
    assert sum(map(len, expected)) > 0


def test_a_refused_picture_is_let_go_while_it_waits_for_the_steps(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path,
) -> None:
    """Its error would hold it."""
    detect, source, goes_on = MotionPipeline.detect, Pictures(bad=5), threading.Event()

    def held_up(self: MotionPipeline, measured: Measured) -> Result:
        goes_on.wait()  # so that it is between two steps before
        return detect(self, measured)

    monkeypatch.setattr(MotionPipeline, 'detect', held_up)
    job, deadline = Job('pictures', tmp_path, PipelineConfig()), time.monotonic() + 60.0
    with frames_done(job, source, MotionPipeline(), None, Tally()):  # type: ignore[arg-type]
        try:
            while len(source.given) <= 5 or source.given[5]() is not None:
                assert time.monotonic() < deadline
                time.sleep(0.01)
        finally:
            goes_on.set()


def test_a_picture_that_the_core_refuses_goes_through_all_steps_in_its_place(tmp_path: Path) -> None:
    job, source = Job('pictures', tmp_path, PipelineConfig()), Pictures(bad=5)
    with frames_done(job, source, MotionPipeline(), None, Tally()) as frames:  # type: ignore[arg-type]
        done = list(frames)
    assert [each.frame.index for each in done] == list(range(FRAMES))
    assert [each.frame.index for each in done if each.result is None] == [5]
    assert 'got (60, 80, 2)' in done[5].refused
