"""The steps from an input to what is written of its frames: each in a thread of its own, some frames ahead of the next.

Within a step one thread does a frame: it takes longer, all of them less long.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass, replace
from itertools import chain
from time import perf_counter

import numpy as np

from motion_detect_ros.cli.batch.jobs import Job
from motion_detect_ros.core.config import PipelineConfig
from motion_detect_ros.core.errors import FrameError, SourceError
from motion_detect_ros.core.frame_decimation import FrameDecimation
from motion_detect_ros.core.pipeline import Measured, MotionPipeline
from motion_detect_ros.core.self_tuning import Tuned
from motion_detect_ros.core.stamp_order import StampOrder, Verdict
from motion_detect_ros.core.threads import limited
from motion_detect_ros.core.types import ByteArray, Result
from motion_detect_ros.results.tally import Tally
from motion_detect_ros.sources.ahead import Ahead
from motion_detect_ros.sources.frames import FrameSource, SourceFrame
from motion_detect_ros.sources.inertial import GyroReplay, InertialSource


@dataclass(frozen=True)
class FrameInWork:
    """What is known of a frame besides its motion. ``image``: None where it is not written; ``calibrated``: whether
    the calibration of the image is known.
    """

    index: int
    decode_ms: float
    image: ByteArray | None
    calibrated: bool
    frame_id: str


@dataclass(frozen=True)
class DoneFrame:
    """What is written of a frame. ``result``: None where the core refused it, ``refused`` says why; ``tuned``: settings
    in use by then.
    """

    frame: FrameInWork
    result: Result | None
    refused: str
    tuned: Tuned


@contextmanager
def frames_done(
    job: Job, source: FrameSource, pipeline: MotionPipeline, gyro: GyroReplay | None, tally: Tally,
) -> Iterator[Iterable[DoneFrame]]:
    """The frames of a source within the block, all steps done. Leaving it ends them, between two frames.

    Raises: what reading, or a step, does.
    """
    decimation = FrameDecimation.by(job.config.load)
    with limited(1), ExitStack() as running:
        frames = running.enter_context(Ahead(_timed(source, job.path, tally)))
        motions = running.enter_context(Ahead(
            _measured(pipeline, _in_order(frames, tally), gyro, decimation, job.overlay)))
        for step in (pipeline.settle, pipeline.follow):
            motions = running.enter_context(Ahead(_each(step, motions)))
        yield running.enter_context(Ahead(_detected(pipeline, motions)))


def gyro_of(source: FrameSource, config: PipelineConfig) -> GyroReplay | None:
    """The angular rates of a source, where the settings want them. Raises: SourceError where it has none."""
    if not config.imu.use:
        return None
    samples = source.gyro() if isinstance(source, InertialSource) else iter(())
    first = next(samples, None)
    if first is None:
        raise SourceError(f'{source.name}: imu.use expects angular rates (a topic of type Imu, oxts), found none')
    return GyroReplay(chain((first,), samples), config.imu.time_offset_s)


@dataclass(frozen=True)
class _TimedFrame:
    """A frame, and what reading and decoding it took; jumped: it is the first of another run of the clock."""

    frame: SourceFrame
    decode_ms: float
    jumped: bool = False


#: A frame, and the first parts of its result, or why the core refuses it.
_Motion = tuple[FrameInWork, Measured | str]


def _timed(source: FrameSource, path: str, tally: Tally) -> Iterator[_TimedFrame]:
    """The frames of a source, with the time each took to read and decode.

    Raises: SourceError where the medium of the source does.
    """
    start = perf_counter()
    try:
        for frame in source:
            decode_ms = 1e3 * (perf_counter() - start)
            tally.read(decode_ms)
            yield _TimedFrame(frame, decode_ms)
            start = perf_counter()
    except OSError as error:
        raise SourceError(f'{path}: cannot be read any more: {error.strerror or error}') from None


def _in_order(frames: Iterable[_TimedFrame], tally: Tally) -> Iterator[_TimedFrame]:
    """Without those whose stamps were seen already or are late."""
    order = StampOrder()
    for timed in frames:
        verdict = order.judge(timed.frame.stamp_ns)
        if verdict.usable:
            yield replace(timed, jumped=verdict == Verdict.JUMP)
        else:
            tally.misstamped_frames += 1


def _measured(
    pipeline: MotionPipeline, frames: Iterable[_TimedFrame], gyro: GyroReplay | None, decimation: FrameDecimation,
    with_images: bool,
) -> Iterator[_Motion]:
    """Each frame that is processed; its image, which may be large, is let go unless it is wanted."""
    for timed in frames:
        if timed.jumped:
            pipeline.clock_jumped()
        if not decimation.keep_next():
            continue
        frame = timed.frame
        for sample in gyro.take(frame.stamp_ns) if gyro else ():
            pipeline.add_gyro(sample.stamp_ns, np.array(sample.rate))
        pipeline.use_camera(frame.camera)
        known = FrameInWork(frame.index, timed.decode_ms, frame.image if with_images else None,
                            frame.camera is not None, frame.frame_id)
        try:
            yield known, pipeline.measure(frame.image, frame.stamp_ns, later=True)
        except FrameError as error:  # a picture of another size or type costs that picture only
            yield known, str(error)  # the error itself holds the image


def _each(step: Callable[[Measured], Measured], frames: Iterable[_Motion]) -> Iterator[_Motion]:
    """These frames a step further, but those that the core refuses."""
    for known, motion in frames:
        yield known, motion if isinstance(motion, str) else step(motion)


def _detected(pipeline: MotionPipeline, frames: Iterable[_Motion]) -> Iterator[DoneFrame]:
    """These frames, through the last step."""
    for known, motion in frames:
        result, refused = (None, motion) if isinstance(motion, str) else (pipeline.detect(motion), '')
        yield DoneFrame(known, result, refused, pipeline.tuned)
