"""``replay``: every frame of a recording through the pipeline in this process, the same answer every time.

With one input the outputs are in OUT_DIR itself, with several in OUT_DIR/<name of the input>.
"""

from __future__ import annotations

import argparse
import math
import multiprocessing
import sys
from collections.abc import Iterable, Iterator
from concurrent.futures import ProcessPoolExecutor, as_completed
from concurrent.futures.process import BrokenProcessPool
from dataclasses import dataclass
from itertools import chain
from pathlib import Path
from time import perf_counter

import cv2
import numpy as np
from tqdm import tqdm

import motion_detect_ros
from motion_detect_ros.cli.ahead import Ahead
from motion_detect_ros.cli.output_folders import folders_of, refuse_existing
from motion_detect_ros.cli.outputs import OUTPUT_NAMES, Percentiles, ReplayOutputs, Summary, Tally, write_summary
from motion_detect_ros.core.config import PipelineConfig
from motion_detect_ros.core.errors import BackendError, FrameError, MotionDetectError, SourceError
from motion_detect_ros.core.frame_decimation import FrameDecimation
from motion_detect_ros.core.pipeline import Measured, MotionPipeline, use_threads
from motion_detect_ros.core.settings import settings
from motion_detect_ros.core.stamp_order import StampOrder
from motion_detect_ros.presets import load_preset
from motion_detect_ros.sources.frames import DEFAULT_FPS, FrameSource, SourceFrame
from motion_detect_ros.sources.inertial import GyroReplay, InertialSource
from motion_detect_ros.sources.opening import open_source

OK, NOTHING, UNREADABLE, PARTIAL = 0, 1, 2, 3


@dataclass(frozen=True)
class Job:
    """One input and where its outputs go."""

    path: str
    folder: Path
    config: PipelineConfig
    fps: float | None = None
    topic: str | None = None
    progress: bool = True


@dataclass(frozen=True)
class Outcome:
    """How a job ended: ``exit_code`` and one ``line`` for the user."""

    exit_code: int
    line: str


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the command line."""
    parser.add_argument('inputs', nargs='+', metavar='IN',
                        help='bag, video, image folder, VisDrone sequence or KITTI drive')
    parser.add_argument('-o', '--output', type=Path, required=True, help='folder for the outputs')
    parser.add_argument('--preset', default='default', help='settings: default, visdrone, kitti, report or a YAML file')
    parser.add_argument('--config', help='YAML file with settings, instead of --preset')
    parser.add_argument('--fps', type=float, help=f'frames/s of inputs without time stamps (default {DEFAULT_FPS:g})')
    parser.add_argument('--topic', help='image topic of a bag that has several')
    parser.add_argument('--workers', type=int, default=1, help='processes, for several inputs; they share the cores')
    parser.add_argument('--force', action='store_true', help='overwrite what an earlier replay left in the folder')
    parser.add_argument('--live', action='store_true', help='play through the ROS nodes instead; bags only')
    parser.add_argument('--rate', type=float, default=1.0, help='with --live: speed against the recording')


def run(arguments: argparse.Namespace) -> int:
    """Replay all inputs; the exit code is that of ``__main__`` that all ended with, 3 where they differ.

    Raises: SourceError for options that contradict each other, and with ``--live`` for an input that is no bag;
    ConfigError for an unknown preset or a wrong value; BackendError where ``--live`` finds no ROS 2.
    """
    if not math.isfinite(arguments.rate) or arguments.rate <= 0:
        raise SourceError(f'--rate: expected a number over 0, got {arguments.rate:g}')
    if arguments.workers < 1:
        raise SourceError(f'--workers: expected 1 or more, got {arguments.workers}')
    if arguments.live:
        _check_live(arguments)
        return _run_live(arguments)
    config = load_preset(arguments.config or arguments.preset)
    jobs = make_jobs(arguments, config)
    outcomes = [*_run_parallel(jobs, arguments.workers)] if arguments.workers > 1 else [*map(run_job, jobs)]
    for outcome in outcomes:
        print(outcome.line, file=sys.stderr if outcome.exit_code == UNREADABLE else sys.stdout)
    codes = {outcome.exit_code for outcome in outcomes}
    return codes.pop() if len(codes) == 1 else PARTIAL


def _check_live(arguments: argparse.Namespace) -> None:
    """Raises: SourceError for an option that says nothing to nodes."""
    if arguments.workers > 1:
        raise SourceError(
            f'--live: expected no --workers, as one graph plays one bag at a time, got {arguments.workers}')
    if arguments.fps is not None:
        raise SourceError(f'--live: expected no --fps, as a bag has stamps of its own, got {arguments.fps:g}')


def _run_live(arguments: argparse.Namespace) -> int:
    """The inputs one after the other through the nodes; raises what they raise."""
    try:
        from motion_detect_ros.cli.live_replay import replay_live
    except ModuleNotFoundError as error:
        raise BackendError(f'--live: expected an installation of ROS 2, but {error.name} is missing') from None
    unanswered = 0
    for job in make_jobs(arguments, PipelineConfig()):
        missing, line = replay_live(
            Path(job.path), job.folder, arguments.config or arguments.preset, arguments.rate, job.topic)
        unanswered += missing
        print(line)
    return PARTIAL if unanswered else OK


def make_jobs(arguments: argparse.Namespace, config: PipelineConfig) -> list[Job]:
    """A job for each input; inputs of the same name get a number behind it. Raises: SourceError for used folders."""
    folders = folders_of(arguments.inputs, arguments.output)
    refuse_existing((folder / name for folder in folders for name in OUTPUT_NAMES), arguments.force)
    return [Job(path, folder, config, arguments.fps, arguments.topic, progress=arguments.workers == 1)
            for path, folder in zip(arguments.inputs, folders, strict=True)]


def run_job(job: Job) -> Outcome:
    """Replay one input; what cannot be read becomes the outcome, so that the other inputs still run."""
    try:
        summary = replay(job)
    except MotionDetectError as error:
        return Outcome(UNREADABLE, f'error: {error}')
    line = (f'{job.folder}: {summary.frames} frames, {summary.detections} detections of {summary.objects} objects, '
            f'{summary.stage_ms["total"].p50:.1f} ms a frame')
    if summary.bad_frames:
        line += f', {summary.bad_frames} bad frames left out'
    if summary.misstamped_frames:
        line += f', {summary.misstamped_frames} left out, their stamps were seen already or late'
    if summary.damaged:
        line += f'; {summary.damaged}'
    if not summary.frames:
        return Outcome(NOTHING, line)
    return Outcome(PARTIAL if summary.bad_frames or summary.damaged else OK, line)


def replay(job: Job) -> Summary:
    """Run one input through a fresh pipeline and write its outputs.

    Raises: SourceError for an unreadable input. Whatever ends the run, outputs and summary hold what was done.
    """
    source = open_source(job.path, job.fps, job.topic)
    pipeline = MotionPipeline(job.config, source.camera)
    gyro, decimation = _gyro(source, job.config), FrameDecimation(
        job.config.load.decimation_keep, job.config.load.decimation_of)
    use_threads(job.config.load)
    tally = Tally()
    complete = False
    try:
        _make_folder(job.folder)
        with ReplayOutputs(job.folder) as outputs:
            bar = tqdm(total=source.frame_count, unit='frame', desc=source.name, disable=None if job.progress else True)
            with bar, Ahead(_timed(source, tally)) as frames, Ahead(
                    _measured(pipeline, _in_order(frames, tally), gyro, decimation)) as measured:
                for index, motion in measured:
                    bar.update(index + 1 - bar.n)
                    if motion is None:
                        tally.bad_frames += 1
                        continue
                    result = pipeline.detect(motion)
                    outputs.write(index, result.stamp_ns, result.detections)
                    tally.add(result)
        complete = True
    finally:
        summary = _summarize(job, source, tally, complete)
        if job.folder.is_dir():
            write_summary(job.folder, summary)
    return summary


def _gyro(source: FrameSource, config: PipelineConfig) -> GyroReplay | None:
    """The angular rates of a source, where the settings want them. Raises: SourceError where it has none."""
    if not config.imu.use:
        return None
    samples = source.gyro() if isinstance(source, InertialSource) else iter(())
    first = next(samples, None)
    if first is None:
        raise SourceError(f'{source.name}: imu.use expects angular rates (a topic of type Imu, oxts), found none')
    return GyroReplay(chain((first,), samples), config.imu.time_offset_s)


def _in_order(frames: Iterable[SourceFrame], tally: Tally) -> Iterator[SourceFrame]:
    """Without those whose stamps were seen already or are late."""
    order = StampOrder()
    for frame in frames:
        if order.judge(frame.stamp_ns).usable:
            yield frame
        else:
            tally.misstamped_frames += 1


def _measured(
    pipeline: MotionPipeline, frames: Iterable[SourceFrame], gyro: GyroReplay | None, decimation: FrameDecimation,
) -> Iterator[tuple[int, Measured | None]]:
    """Number of each frame that is processed and the first half of its result, None for one that the core refuses."""
    for frame in frames:
        if not decimation.keep_next():
            continue
        for sample in gyro.take(frame.stamp_ns) if gyro else ():
            pipeline.add_gyro(sample.stamp_ns, np.array(sample.rate))
        try:
            yield frame.index, pipeline.measure(frame.image, frame.stamp_ns)
        except FrameError:  # a picture of another size or type costs that picture only
            yield frame.index, None


def _timed(source: FrameSource, tally: Tally) -> Iterator[SourceFrame]:
    """The frames of a source, with the time each took to read and decode."""
    start = perf_counter()
    for frame in source:
        tally.decode_ms.append(1e3 * (perf_counter() - start))
        tally.source_frames = max(tally.source_frames, frame.index + 1)
        yield frame
        start = perf_counter()


def _make_folder(folder: Path) -> None:
    try:
        folder.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise SourceError(f'{folder}: cannot be made a folder for the outputs: {error.strerror}') from None


def _summarize(job: Job, source: FrameSource, tally: Tally, complete: bool) -> Summary:
    stamps = tally.stamps_ns or [0]
    return Summary(
        input=str(job.path), version=motion_detect_ros.__version__, complete=complete, damaged=source.damaged,
        announced_frames=source.frame_count, frames=tally.frames, bad_frames=tally.bad_frames + source.bad_frames,
        misstamped_frames=tally.misstamped_frames, source_frames=tally.source_frames,
        detections=tally.detections, objects=len(tally.ids), ego_status=dict(tally.ego_status),
        image_size=tally.image_size, calibrated=source.camera is not None, first_stamp_ns=stamps[0],
        last_stamp_ns=stamps[-1], stage_ms=tally.stage_ms(), decode_ms=Percentiles.of(tally.decode_ms),
        settings={name: value for name, value, _ in settings(job.config)})


def worker_pool(workers: int) -> ProcessPoolExecutor:
    """Processes that share the cores: each gives OpenCV its part of the threads, unless ``load.threads`` says how many.

    Spawned, not forked: OpenCV's and numba's thread pools do not survive a fork.
    """
    context = multiprocessing.get_context('spawn')
    return ProcessPoolExecutor(workers, mp_context=context, initializer=_share_cores, initargs=(workers,))


def _share_cores(workers: int) -> None:
    cv2.setNumThreads(max(1, cv2.getNumThreads() // workers))


def _run_parallel(jobs: list[Job], workers: int) -> Iterator[Outcome]:
    with worker_pool(min(workers, len(jobs))) as pool:
        futures = [pool.submit(run_job, job) for job in jobs]
        for _ in tqdm(as_completed(futures), total=len(futures), unit='input', disable=None):
            pass
        for job, future in zip(jobs, futures, strict=True):
            try:
                yield future.result()
            except BrokenProcessPool:
                yield Outcome(NOTHING, f'{job.path}: the worker process died (out of memory?)')
