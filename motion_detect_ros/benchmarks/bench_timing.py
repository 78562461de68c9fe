"""Taking times that mean something on a machine that others use too: percentiles, and ratios of interleaved runs."""

from __future__ import annotations

import math
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import lru_cache, partial

import cv2
import numpy as np

from motion_detect_ros.core.config import PipelineConfig
from motion_detect_ros.core.ego_motion.features import BLOCK_PX
from motion_detect_ros.core.flow_methods.registry import make_flow
from motion_detect_ros.core.geometry.warp import at_scale, stabilise
from motion_detect_ros.core.pipeline import MotionPipeline
from motion_detect_ros.core.preprocessing.stage import at_working_width
from motion_detect_ros.core.types import ByteArray, DoubleArray
from motion_detect_ros.sources.synthetic import FlightConfig, SyntheticFlight

#: Frames at the start that are not timed.
WARM_FRAMES = 5

Frames = tuple[tuple[ByteArray, int], ...]
Step = Callable[[int], object]
Clock = Callable[[], float]


@dataclass(frozen=True)
class Timing:
    """One row: milliseconds."""

    name: str
    p50: float
    p95: float
    p99: float

    @classmethod
    def of(cls, name: str, times_ms: Sequence[float]) -> Timing:
        """Percentiles of the finite ones; NaN where there are none."""
        known = np.array([value for value in times_ms if math.isfinite(value)] or [math.nan])
        p50, p95, p99 = np.percentile(known, [50, 95, 99])
        return cls(name, round(float(p50), 2), round(float(p95), 2), round(float(p99), 2))


@dataclass(frozen=True)
class Ratio:
    """Two ways over the same frames: medians of their times, milliseconds, and the median of the ratios by frame."""

    name: str
    ms: float
    base_ms: float
    ratio: float

    @classmethod
    def of(cls, name: str, times_ms: DoubleArray) -> Ratio:
        """times_ms: (N, 2), the way that is judged and the one it is judged by."""
        ratios = times_ms[:, 0] / times_ms[:, 1]
        ms, base_ms = np.median(times_ms, axis=0)
        return cls(name, round(float(ms), 2), round(float(base_ms), 2), round(float(np.median(ratios)), 3))


@lru_cache(maxsize=2)
def flight(config: FlightConfig) -> Frames:
    """The pictures of a flight with their stamps, nanoseconds."""
    return tuple((frame.image, frame.stamp_ns) for frame in SyntheticFlight(config))


def elapsed_ms(action: Callable[[], object], clock: Clock = time.perf_counter) -> float:
    """How long one call takes."""
    start = clock()
    action()
    return 1e3 * (clock() - start)


def interleaved(
    steps: Sequence[Step], frames: int, warm_frames: int = WARM_FRAMES, clock: Clock = time.perf_counter,
) -> DoubleArray:
    """(frames - warm_frames, len(steps)) milliseconds of ``step(index)`` by ``clock``, seconds.

    Every step has its turn at every frame, and the order turns round from frame to frame, so that whatever else the
    machine does falls on all of them alike.
    """
    times = np.full((frames, len(steps)), np.nan)
    for index in range(frames):
        for turn in range(len(steps)):
            which = (turn + index) % len(steps)
            times[index, which] = elapsed_ms(partial(steps[which], index), clock)
    return times[warm_frames:]


class OpenCvFloor:
    """The OpenCV calls that no pipeline of this kind can do without, at the settings of a preset.

    Grey and working size, corners, pyramidal Lucas-Kanade forward and backward, the warp of the earlier frame, dense
    flow forward and backward. matrices: (3, 3) of each frame, previous pixel -> current pixel, full resolution.
    """

    def __init__(self, config: PipelineConfig, frames: Frames, matrices: Sequence[DoubleArray]) -> None:
        self._config = config
        self._frames = frames
        self._matrices = matrices
        self._flow = make_flow(config.optical_flow)
        self._previous: ByteArray | None = None

    def step(self, index: int) -> None:
        """One frame; the frames come in order."""
        gray, scale = self._prepared(self._frames[index][0])
        if self._previous is not None:
            self._track(self._previous, gray)
            earlier = stabilise(self._previous, at_scale(self._matrices[index], scale))
            self._flow(gray, earlier)
            self._flow(earlier, gray)
        self._previous = gray

    def _prepared(self, image: ByteArray) -> tuple[ByteArray, float]:
        gray = image if image.ndim == 2 else cv2.cvtColor(image, cv2.COLOR_BGR2GRAY)
        working = self._config.preprocessing
        return at_working_width(gray, working.min_width_px, working.max_width_px)

    def _track(self, previous: ByteArray, current: ByteArray) -> None:
        config = self._config.ego_motion
        points = cv2.goodFeaturesToTrack(previous, config.max_corners, config.corner_quality, BLOCK_PX)
        if points is None:
            return
        options = {'winSize': (config.lk_window_px, config.lk_window_px), 'maxLevel': config.pyramid_levels}
        moved, _, _ = cv2.calcOpticalFlowPyrLK(previous, current, points, None, **options)
        cv2.calcOpticalFlowPyrLK(current, previous, moved, None, **options)


def not_enlarging(config: PipelineConfig) -> PipelineConfig:
    """The same settings for images that are worked on as they are, however small."""
    return replace(config, preprocessing=replace(config.preprocessing, min_width_px=0))


def floor_times(config: PipelineConfig, frames: Frames, clock: Clock = time.perf_counter) -> DoubleArray:
    """(N, 2) milliseconds of the whole pipeline and of ``OpenCvFloor``, frame by frame in turn."""
    scout = MotionPipeline(config)
    matrices = [scout.process(image, stamp_ns).ego.matrix for image, stamp_ns in frames]
    floor = OpenCvFloor(config, frames, matrices)
    return interleaved([_stepper(config, frames), floor.step], len(frames), clock=clock)


def background_times(config: PipelineConfig, frames: Frames) -> DoubleArray:
    """(N, 2) milliseconds of the pipeline with an epipolar and with a planar background, frame by frame in turn."""
    models = [replace(config, background=replace(config.background, model=name)) for name in ('epipolar', 'planar')]
    return interleaved([_stepper(model, frames) for model in models], len(frames))


def _stepper(config: PipelineConfig, frames: Frames) -> Step:
    pipeline = MotionPipeline(config)

    def step(index: int) -> None:
        pipeline.process(*frames[index])
        pipeline.wait()

    return step
