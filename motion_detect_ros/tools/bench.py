"""``bench``: time per stage, codec, and from image to detections over real processes; on the built-in flight."""

from __future__ import annotations

import argparse
import json
import os
import platform
import tempfile
import time
from collections.abc import Callable
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

import cv2
import numpy as np

from motion_detect_ros.core.errors import BackendError
from motion_detect_ros.core.pipeline import MotionPipeline, warm_up
from motion_detect_ros.core.types import StageTimes
from motion_detect_ros.presets import load_preset
from motion_detect_ros.sources.bags import BagWriter
from motion_detect_ros.sources.synthetic import FlightConfig, SyntheticFlight

SIZES = ((640, 360), (960, 540), (1280, 720))
STAGE_NAMES = ('preprocessing', 'ego_motion', 'optical_flow', 'clustering', 'total')
#: Frames at the start that are not timed.
WARM_FRAMES = 5
CODEC_ROUNDS = 100
#: Images come at this share of what the stages can do one after the other.
LOAD_SHARE = 0.5
GRAPHS: dict[str, tuple[str, ...]] = {
    'four processes': ('ego_motion', 'optical_flow', 'art2_clustering'),
    'pipeline': ('pipeline',),
}


@dataclass(frozen=True)
class Timing:
    """One row: milliseconds."""

    name: str
    p50: float
    p95: float
    p99: float

    @classmethod
    def of(cls, name: str, times_ms: list[float]) -> Timing:
        """Percentiles of the finite ones."""
        known = np.array([value for value in times_ms if np.isfinite(value)] or [np.nan])
        p50, p95, p99 = np.percentile(known, [50, 95, 99])
        return cls(name, round(float(p50), 2), round(float(p95), 2), round(float(p99), 2))


@dataclass(frozen=True)
class Latency:
    """From image to detections over DDS. ``rate_hz``: images a second; ``answered`` of ``images``."""

    timing: Timing
    rate_hz: float
    images: int
    answered: int


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the command line."""
    parser.add_argument('--preset', default='default', help='settings: default, visdrone or kitti, or a YAML file')
    parser.add_argument('--frames', type=int, default=60, help='frames of each measurement')
    parser.add_argument('--no-nodes', action='store_true', help='leave the nodes out, measure in this process only')
    parser.add_argument('--json', type=Path, help='write the figures here too')


def run(arguments: argparse.Namespace) -> int:
    """Measure and print markdown tables."""
    frames = max(2 * WARM_FRAMES, arguments.frames)
    stages = {f'{width}x{height}': stage_times(width, height, frames, arguments.preset) for width, height in SIZES}
    codec = codec_times()
    latencies = [] if arguments.no_nodes else node_latencies(frames, arguments.preset, stages['960x540'])
    print('\n'.join(report(stages, codec, latencies)))
    if arguments.json:
        figures: dict[str, Any] = {
            'stages_ms': {size: [asdict(row) for row in rows] for size, rows in stages.items()},
            'codec_720p_ms': [asdict(row) for row in codec], 'latency': [asdict(row) for row in latencies]}
        arguments.json.write_text(json.dumps(figures, indent=2) + '\n', encoding='utf-8')
    return 0


def stage_times(width: int, height: int, frames: int, preset: str) -> list[Timing]:
    """Compute time of every stage, decoded frame to detections."""
    config = load_preset(preset)
    warm_up(config)
    pipeline, times = MotionPipeline(config), list[StageTimes]()
    for frame in SyntheticFlight(FlightConfig(width=width, height=height, frames=frames)):
        times.append(pipeline.process(frame.image, frame.stamp_ns).times_ms)
    return [Timing.of(name, [getattr(each, name) for each in times[WARM_FRAMES:]]) for name in STAGE_NAMES]


def codec_times() -> list[Timing]:
    """A 1280x720 bgr8 image to a message and back; with the allocator as the nodes set it."""
    try:
        from motion_detect_ros.bridge.images import header_of, image_from_msg, image_to_msg
        from motion_detect_ros.bridge.transport import tune_malloc
    except ModuleNotFoundError as error:
        raise BackendError(f'bench: expected an installation of ROS 2, but {error.name} is missing') from None
    tune_malloc()
    image = np.zeros((720, 1280, 3), np.uint8)
    header = header_of(0, 'camera')
    message = image_to_msg(image, header)
    return [Timing.of('to message', _repeated(lambda: image_to_msg(image, header))),
            Timing.of('from message', _repeated(lambda: image_from_msg(message)))]


def node_latencies(frames: int, preset: str, stages: list[Timing]) -> list[Latency]:
    """The 960x540 flight through the nodes as processes, at half of what the stages can do."""
    from motion_detect_ros.tools.live import LiveGraph
    config = FlightConfig(frames=frames)
    speed = min(1.0, LOAD_SHARE * 1e3 / (stages[-1].p50 * config.fps))
    found = []
    with tempfile.TemporaryDirectory() as folder:
        bag = Path(folder) / 'flight.mcap'
        with BagWriter(bag, compress=False) as writer:
            for frame in SyntheticFlight(config):
                writer.write_image(frame.image, frame.stamp_ns)
        for name, nodes in GRAPHS.items():
            with LiveGraph(preset, nodes) as graph:
                played = graph.play(bag, frames, speed)
            times = [message.latency_ms for message in played.received[WARM_FRAMES:]]
            found.append(Latency(Timing.of(name, times), speed * config.fps, frames, len(played.received)))
    return found


def report(stages: dict[str, list[Timing]], codec: list[Timing], latencies: list[Latency]) -> list[str]:
    """Markdown tables."""
    machine = f'{os.cpu_count()} cores of {platform.machine()}'
    library = f'OpenCV {cv2.__version__} with {cv2.getNumThreads()} threads'
    lines = [f'Built-in flight, {library}, {machine}. Median / 95th percentile, ms.', '',
             '| image | ' + ' | '.join(STAGE_NAMES) + ' |', '|---' * (len(STAGE_NAMES) + 1) + '|']
    lines += [f'| {size} | ' + ' | '.join(f'{row.p50:.1f} / {row.p95:.1f}' for row in rows) + ' |'
              for size, rows in stages.items()]
    lines += ['', '| 1280x720 bgr8 | median | p95 |', '|---|---|---|']
    lines += [f'| {row.name} | {row.p50:.2f} | {row.p95:.2f} |' for row in codec]
    if latencies:
        lines += ['', '| image to detections, 960x540 | images a second | median | p95 | p99 | answered |',
                  '|---|---|---|---|---|---|']
        lines += [f'| {row.timing.name} | {row.rate_hz:.1f} | {row.timing.p50:.1f} | {row.timing.p95:.1f} | '
                  f'{row.timing.p99:.1f} | {row.answered} of {row.images} |' for row in latencies]
    return lines


def _repeated(action: Callable[[], object]) -> list[float]:
    times = []
    for _ in range(CODEC_ROUNDS):
        start = time.perf_counter()
        action()
        times.append(1e3 * (time.perf_counter() - start))
    return times
