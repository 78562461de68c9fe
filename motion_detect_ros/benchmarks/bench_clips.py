"""``bench``, on real pictures: the detector and two plain methods take turns over the frames of real clips."""

from __future__ import annotations

import os
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from itertools import islice
from pathlib import Path
from typing import Any

import cv2
import numpy as np

from motion_detect_ros.benchmarks.accuracy_clips import DATA_DEFAULT, DATA_VARIABLE, Clip, read_clips
from motion_detect_ros.benchmarks.bench_timing import Frames, Step
from motion_detect_ros.benchmarks.plain_methods import (
    CLUSTERER,
    DIFFERENCE,
    RESIDUALS,
    Method,
    ResidualClusters,
    ThreeFrameDifference,
    measure_step,
)
from motion_detect_ros.core.config import PipelineConfig, PreprocessingConfig
from motion_detect_ros.core.errors import BackendError
from motion_detect_ros.core.load_control import STEPS
from motion_detect_ros.core.pipeline import MotionPipeline, warm_up
from motion_detect_ros.core.preprocessing.stage import Preprocessor
from motion_detect_ros.core.threads import limited, threads
from motion_detect_ros.core.types import ByteArray, CameraModel, DoubleArray, PreparedFrame
from motion_detect_ros.presets import load_preset

#: What is measured where it is there.
CLIPS = ('visdrone_uav0000305_00000_v', 'visdrone_uav0000339_00001_v', 'uavdt_M1303', 'kitti_drive_0005')
#: Frames at the start that are not timed: points are tracked over a second.
WARM_FRAMES = 12
_SOMETHING = np.zeros((512, 512), np.uint8)
OURS, ONE_THREAD = 'ours', 'ours, one thread'


@dataclass(frozen=True)
class Cost:
    """One way on one clip: time of a frame to its answer, ms; the mean counts that not all frames are alike.

    ``ready``: mean until all that is done behind the answer is done too, as if nothing could be done meanwhile;
    ``processor``: mean of all threads, that included.
    """

    name: str
    mean: float
    p50: float
    p95: float
    ready: float
    processor: float

    @classmethod
    def of(cls, name: str, times_ms: DoubleArray) -> Cost:
        """times_ms: (N, 3) to the answer, until ready, processor time."""
        p50, p95 = np.percentile(times_ms[:, 0], [50, 95]).tolist()
        mean, ready, processor = times_ms.mean(axis=0).tolist()
        return cls(name, *(round(value, 2) for value in (mean, p50, p95, ready, processor)))


@dataclass(frozen=True)
class Way:
    """``step``: answers a frame, by its index; ``wait``: for what it does behind that answer; ``opencv_threads``: how
    many OpenCV has meanwhile, 0 = as many as there are.
    """

    step: Step
    wait: Callable[[], object] = lambda: None
    opencv_threads: int = 0


class Plain:
    """A plain method as a whole: grey and working size, corners, tracks, affine, boxes."""

    def __init__(self, method: Method, frames: Frames, config: PreprocessingConfig) -> None:
        self._method, self._frames = method, frames
        self._prepare = Preprocessor(config)
        self._before: ByteArray | None = None

    def step(self, index: int) -> None:
        """One frame; the frames come in order."""
        prepared: PreparedFrame = self._prepare.process(*self._frames[index])
        seen = np.full(prepared.gray.shape, 255, np.uint8)
        if prepared.mask is not None:
            seen[~prepared.mask] = 0
        step = None if self._before is None else measure_step(self._before, prepared.gray, seen)
        self._method.boxes(step)
        self._before = prepared.gray


def clips_there() -> list[Clip]:
    """Those of ``CLIPS`` that are there; none without ``MOTION_DETECT_DATA``."""
    data = Path(os.environ.get(DATA_VARIABLE, DATA_DEFAULT))
    if not (data / 'clips.json').is_file():
        return []
    there = {clip.name: clip for clip in read_clips(data)}
    return [there[name] for name in CLIPS if name in there]


def first_clip() -> Clip | None:
    """The first of ``clips_there``."""
    return next(iter(clips_there()), None)


def clip_costs(frames: int) -> list[dict[str, Any]]:
    """Rows of every clip of ``clips_there``."""
    return [_costs(clip, frames) for clip in clips_there()]


def _costs(clip: Clip, frames: int) -> dict[str, Any]:
    source = clip.source()
    seen = tuple((frame.image, frame.stamp_ns) for frame in islice(source, WARM_FRAMES + frames))
    height, width = seen[0][0].shape[:2]
    config = load_preset(clip.preset)
    warm_up(config)
    methods: dict[str, Method] = {DIFFERENCE: ThreeFrameDifference()}
    if _there(CLUSTERER.require):
        methods[RESIDUALS] = ResidualClusters()
    with limited(0):
        ways: dict[str, Way] = {OURS: _ours(config, source.camera, seen)}
    ways |= {name: Way(Plain(method, seen, config.preprocessing).step) for name, method in methods.items()}
    with limited(0):
        rows = _interleaved(ways, len(seen))
    with limited(1):
        rows += _interleaved({ONE_THREAD: _ours(config, source.camera, seen)}, len(seen))
    for share in sorted({step.width_share for step in STEPS if step.width_share < 1.0}, reverse=True):
        with limited(0):
            narrow = _ours(config, source.camera, seen, share)
            rows += _interleaved({f'ours, {share:.0%} of the width': narrow}, len(seen))
    return {'clip': clip.name, 'size': f'{width}x{height}', 'rows': [vars(row) for row in rows]}


def _ours(config: PipelineConfig, camera: CameraModel | None, frames: Frames, share: float = 1.0) -> Way:
    pipeline = MotionPipeline(config, camera)
    pipeline.limit_width(share)
    return Way(lambda index: pipeline.process(*frames[index]), pipeline.wait, cv2.getNumThreads())


def _interleaved(ways: dict[str, Way], frames: int) -> list[Cost]:
    """Each way has its turn at every frame, and the order turns round."""
    names = list(ways)
    times = np.zeros((len(names), frames, 3))
    for index in range(frames):
        for turn in range(len(names)):
            which = (turn + index) % len(names)
            times[which, index] = _elapsed_ms(ways[names[which]], index)
    return [Cost.of(name, times[which, WARM_FRAMES:]) for which, name in enumerate(names)]


def _elapsed_ms(way: Way, index: int) -> Sequence[float]:
    cv2.setNumThreads(way.opencv_threads or threads())
    cv2.blur(_SOMETHING, (3, 3))  # wakes threads that were not there for the way before
    wall, processor = time.perf_counter(), time.process_time()
    way.step(index)
    answered = time.perf_counter()
    way.wait()
    ready = time.perf_counter()
    return 1e3 * (answered - wall), 1e3 * (ready - wall), 1e3 * (time.process_time() - processor)


def _there(require: Callable[[], None]) -> bool:
    try:
        require()
    except BackendError:
        return False
    return True
