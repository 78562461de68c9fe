"""``bench``, over real processes: latency beyond compute, drops, start-up, memory."""

from __future__ import annotations

import tempfile
import time
from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import partial
from itertools import islice

from motion_detect_ros.benchmarks.accuracy_clips import Clip
from motion_detect_ros.benchmarks.bench_clips import first_clip
from motion_detect_ros.benchmarks.bench_nodes import NodeProcesses
from motion_detect_ros.benchmarks.bench_timing import Timing, flight
from motion_detect_ros.benchmarks.feeder import Answer, Feeder
from motion_detect_ros.cli.domains import own_domain
from motion_detect_ros.core.errors import SourceError
from motion_detect_ros.core.types import ByteArray
from motion_detect_ros.presets import preset_path
from motion_detect_ros.sources.synthetic import FlightConfig

#: The graphs under measurement; the fourth node of ``four nodes`` is the camera, which is this process.
GRAPHS: dict[str, tuple[str, ...]] = {
    'pipeline': ('pipeline',),
    'four nodes': ('ego_motion', 'optical_flow', 'art2_clustering'),
}
#: Pictures a second: as a camera sends them, and slow enough for nothing to wait.
RATE_HZ = 20.0
RATES_HZ = (RATE_HZ, 10.0)
#: What makes ``pipeline`` do less where it cannot keep up.
ADAPT = 'load.adapt'
#: Pictures of the flight that is fed forwards and backwards.
LOOP_FRAMES = 60
#: Pictures at the start that do not count, and longest waits, seconds.
SETTLE_FRAMES = 40
START_TIMEOUT_S, ANSWER_TIMEOUT_S, POLL_S = 180.0, 2.0, 0.005
#: Memory is read after this many pictures, and at the end.
EARLY_FRAMES = 100


@dataclass(frozen=True)
class Latency:
    """From the picture's stamp to its detections over DDS.

    ``compute_ms``: sum of the nodes' own medians (decode, stage, publish); ``beyond_ms``: median latency less that;
    ``lost``: pictures without detections, of ``images``.
    """

    timing: Timing
    rate_hz: float
    compute_ms: float
    beyond_ms: float
    images: int
    lost: int


@dataclass(frozen=True)
class Memory:
    """Resident megabytes of ``pipeline`` at 960x540 after ``early_frames`` and after ``frames`` pictures."""

    early_frames: int
    early_mb: float
    frames: int
    mb: float


@dataclass(frozen=True)
class StartUp:
    """From the start of the ``pipeline`` process to its first message, kernels cached and not: seconds, and the
    process's resident megabytes then.
    """

    warm_s: float
    cold_s: float
    warm_mb: float
    cold_mb: float


def pictures(width: int = 960, height: int = 540) -> list[ByteArray]:
    """The flight that is fed."""
    return [image for image, _ in flight(FlightConfig(width=width, height=height, frames=LOOP_FRAMES))]


def clip_pictures(clip: Clip, frames: int) -> list[ByteArray]:
    """The first pictures of a real clip."""
    return [frame.image for frame in islice(clip.source(), frames)]


def latencies(preset: str, frames: int) -> list[Latency]:
    """The 960x540 flight through every graph of ``GRAPHS`` at every rate of ``RATES_HZ``."""
    return [_one_graph(preset, name, frames, rate_hz, pictures()) for rate_hz in RATES_HZ for name in GRAPHS]


def clip_latencies(frames: int) -> list[Latency]:
    """The same with the pictures and the preset of the first real clip that is there, at ``RATE_HZ``; else none.

    Also ``pipeline`` with ``load.adapt``.
    """
    clip = first_clip()
    if clip is None:
        return []
    images = clip_pictures(clip, LOOP_FRAMES)
    as_it_is = [_one_graph(clip.preset, name, frames, RATE_HZ, images) for name in GRAPHS]
    adapting = _one_graph(clip.preset, 'pipeline', frames, RATE_HZ, images, (f'{ADAPT}:=true',))
    return [*as_it_is, replace(adapting, timing=replace(adapting.timing, name=f'pipeline, {ADAPT}'))]


def _one_graph(
    preset: str, name: str, frames: int, rate_hz: float, images: list[ByteArray], changes: tuple[str, ...] = (),
) -> Latency:
    domain, nodes, settings = own_domain(), GRAPHS[name], (*parameters(preset), *changes)
    with Feeder(domain, images, rate_hz) as feeder, NodeProcesses(nodes, domain, settings) as processes:
        await_nodes(feeder, processes, len(nodes))
        feed(feeder, processes, SETTLE_FRAMES)
        before = feeder.sent
        answers = feed(feeder, processes, frames)
        compute_ms = sum(float(feeder.diagnostics(node).get('latency_p50_ms', 'nan')) for node in nodes)
        return _latency(name, answers, feeder.sent - before, rate_hz, compute_ms)


def feed(feeder: Feeder, processes: NodeProcesses, frames: int) -> list[Answer]:
    """Feed so many pictures more; their detections."""
    before = feeder.sent
    feeder.go()
    await_that(partial(_sent, feeder, before + frames), processes, START_TIMEOUT_S + frames)
    return settle(feeder)


def parameters(preset: str) -> tuple[str, ...]:
    """The preset as the nodes take it. Raises: ConfigError where there is none."""
    return (str(preset_path(preset)),)


def _latency(name: str, answers: list[Answer], images: int, rate_hz: float, compute_ms: float) -> Latency:
    timing = Timing.of(name, [answer.latency_ms for answer in answers])
    return Latency(timing, rate_hz, round(compute_ms, 2), round(timing.p50 - compute_ms, 2), images,
                   images - len({answer.stamp_ns for answer in answers}))


def settle(feeder: Feeder) -> list[Answer]:
    """Stop feeding; all detections up to then and shortly after."""
    feeder.pause()
    answers, deadline = feeder.take(), time.monotonic() + ANSWER_TIMEOUT_S
    while time.monotonic() < deadline:
        time.sleep(0.1)
        answers += feeder.take()
    return answers


def memory(preset: str, frames: int) -> Memory:
    """``pipeline`` alone, fed at ``RATE_HZ``."""
    domain = own_domain()
    with Feeder(domain, pictures(), RATE_HZ) as feeder, \
            NodeProcesses(('pipeline',), domain, parameters(preset)) as processes:
        await_nodes(feeder, processes, 1)
        feeder.go()
        found = []
        for count in (EARLY_FRAMES, frames):
            await_that(partial(_sent, feeder, count), processes, START_TIMEOUT_S + count)
            found.append(processes.memory_mb('pipeline'))
    return Memory(EARLY_FRAMES, found[0], frames, found[1])


def start_up(preset: str) -> StartUp:
    """The second of two starts for the warm figure, so that the cache is full; a new cache for the cold one."""
    with tempfile.TemporaryDirectory(prefix='numba_cold_') as folder:
        cold_s, cold_mb = first_answer(preset, {'NUMBA_CACHE_DIR': folder})
        warm_s, warm_mb = first_answer(preset, {'NUMBA_CACHE_DIR': folder})
    return StartUp(round(warm_s, 2), round(cold_s, 2), warm_mb, cold_mb)


def first_answer(preset: str, variables: dict[str, str]) -> tuple[float, float]:
    """Seconds from the start of a ``pipeline`` process, while pictures come, to its first detections; its megabytes."""
    domain = own_domain()
    with Feeder(domain, pictures(), RATE_HZ) as feeder:
        feeder.go()
        start_s = time.monotonic()
        with NodeProcesses(('pipeline',), domain, parameters(preset), variables) as processes:
            await_that(lambda: bool(feeder.take()), processes, START_TIMEOUT_S)
            return time.monotonic() - start_s, processes.memory_mb('pipeline')


def await_nodes(feeder: Feeder, processes: NodeProcesses, count: int) -> None:
    """Until ``count`` nodes subscribe and publish detections. Raises: SourceError where one ends or none comes up."""
    await_that(lambda: feeder.subscribers >= count, processes, START_TIMEOUT_S)
    feeder.go()
    await_that(lambda: bool(feeder.take()), processes, START_TIMEOUT_S)
    settle(feeder)


def _sent(feeder: Feeder, count: int) -> bool:
    return feeder.sent >= count


def await_that(condition: Callable[[], bool], processes: NodeProcesses, timeout_s: float) -> None:
    """Wait. Raises: SourceError where a node ends, or the time is over."""
    deadline = time.monotonic() + timeout_s
    while not condition():
        processes.check()
        if time.monotonic() > deadline:
            raise SourceError(f'nodes: expected detections within {timeout_s:.0f} s')
        time.sleep(POLL_S)

