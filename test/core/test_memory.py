"""What the pipeline holds, and makes within a frame, of the size of an image: bounded, and not growing."""

from __future__ import annotations

import tracemalloc
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pytest

from motion_detect_ros.core.geometry.motion_chain import MAX_LINKS
from motion_detect_ros.core.pipeline import MotionPipeline, warm_up
from motion_detect_ros.core.settings import with_settings
from motion_detect_ros.presets import load_preset
from motion_detect_ros.sources.synthetic import FlightConfig, SyntheticFlight

WIDTH, HEIGHT, FPS, FRAMES = 480, 270, 20.0, 70
FULL = WIDTH * HEIGHT


@dataclass(frozen=True)
class Held:
    """After each frame, and at most within it beyond what was held before; grey images. ``large``: arrays of half an
    image and more at the end, by file.
    """

    after: list[float]
    within: list[float]
    large: dict[str, int]


@pytest.fixture(scope='module', params=['visdrone', 'kitti'])
def held(request: pytest.FixtureRequest) -> tuple[str, Held]:
    """Three and a half seconds of the built-in flight."""
    config = with_settings(load_preset(request.param), {'preprocessing.min_width_px': 0})  # as of wide pictures
    flight = FlightConfig(width=WIDTH, height=HEIGHT, focal_px=0.75 * WIDTH, frames=FRAMES, fps=FPS)
    frames = [(frame.image, frame.stamp_ns) for frame in SyntheticFlight(flight)]
    warm_up(config)
    pipeline, after, within = MotionPipeline(config), [], []
    tracemalloc.start()
    try:
        for image, stamp_ns in frames:
            before = tracemalloc.get_traced_memory()[0]
            tracemalloc.reset_peak()
            pipeline.process(image, stamp_ns)
            pipeline.wait()
            now, peak = tracemalloc.get_traced_memory()
            after.append(now / FULL)
            within.append((peak - before) / FULL)
        large: dict[str, int] = {}
        for trace in tracemalloc.take_snapshot().traces:
            if trace.size >= FULL / 2:
                name = '/'.join(Path(trace.traceback[0].filename).parts[-2:])
                large[name] = large.get(name, 0) + 1
    finally:
        tracemalloc.stop()
    return request.param, Held(after, within, large)


def test_it_does_not_grow(held: tuple[str, Held]) -> None:
    after = held[1].after
    assert np.median(after[-15:]) < np.median(after[25:40]) + 1.0


def test_large_arrays_are_the_frames_that_are_looked_back_to(held: tuple[str, Held]) -> None:
    """A second of grey images with points, 21 at 20 Hz, as many as links are chained without; few others, of which
    three are masks: of the scene, and of where windows of features and points see nothing but the scene.
    """
    preset, found = held
    frames, images = 22 if preset == 'visdrone' else MAX_LINKS + 1, found.large['preprocessing/stage.py']
    assert 1 < images <= frames
    assert sum(found.large.values()) - images <= 10, found.large


def test_a_frame_makes_a_bounded_number_more(held: tuple[str, Held]) -> None:
    assert 1.0 < max(held[1].within[10:]) < 30.0
