"""``bench``, in this process: time per stage, against the floor that OpenCV sets, planar against 3-D, and the codec."""

from __future__ import annotations

import time
from dataclasses import asdict, dataclass
from typing import Any

import numpy as np

from motion_detect_ros.benchmarks.bench_timing import (
    WARM_FRAMES,
    Frames,
    Ratio,
    Timing,
    background_times,
    elapsed_ms,
    flight,
    floor_times,
    not_enlarging,
)
from motion_detect_ros.core.config import PipelineConfig
from motion_detect_ros.core.errors import BackendError
from motion_detect_ros.core.pipeline import MotionPipeline, warm_up
from motion_detect_ros.core.threads import limited
from motion_detect_ros.core.types import StageTimes
from motion_detect_ros.presets import load_preset
from motion_detect_ros.sources.synthetic import FlightConfig

SIZES = ((640, 360), (960, 540), (1280, 720))
STAGE_NAMES = ('preprocessing', 'ego_motion', 'optical_flow', 'clustering', 'total')
CODEC_ROUNDS = 100
ONE_THREAD_PRESETS = ('default', 'visdrone', 'kitti')


@dataclass(frozen=True)
class Reported:
    """A table of the report: image size, preset, and milliseconds by stage, assisted by a graphics card."""

    name: str
    width: int
    height: int
    preset: str
    published_ms: tuple[float, ...]


#: The two tables of the report (preprocessing, ego-motion, flow, clustering, total), at the data sets' image sizes.
REPORTED = (
    Reported('VisDrone', 1344, 756, 'visdrone', (14.0, 11.0, 19.0, 16.0, 60.0)),
    Reported('KITTI', 1242, 374, 'kitti', (13.0, 16.0, 19.0, 15.0, 63.0)),
)


def stage_times(config: PipelineConfig, frames: Frames) -> list[Timing]:
    """Compute time of every stage, decoded frame to detections; ``processor``: of all threads, for the whole frame."""
    pipeline, times, processor = MotionPipeline(config), list[StageTimes](), list[float]()
    for image, stamp_ns in frames:
        start = time.process_time()
        times.append(pipeline.process(image, stamp_ns).times_ms)
        pipeline.wait()
        processor.append(1e3 * (time.process_time() - start))
    rows = [Timing.of(name, [getattr(each, name) for each in times[WARM_FRAMES:]]) for name in STAGE_NAMES]
    return [*rows, Timing.of('processor', processor[WARM_FRAMES:])]


def stages(preset: str, frames: int) -> dict[str, list[Timing]]:
    """``stage_times`` at every size of ``SIZES``, not enlarged."""
    config = not_enlarging(load_preset(preset))
    warm_up(config)
    return {f'{width}x{height}': stage_times(config, flight(FlightConfig(width=width, height=height, frames=frames)))
            for width, height in SIZES}


def one_thread(frames: int) -> list[dict[str, Any]]:
    """Stages of each of ``ONE_THREAD_PRESETS`` and the OpenCV floor, on one thread, 960x540 of the built-in flight."""
    with limited(1):
        pictures, rows = flight(FlightConfig(frames=frames)), []
        for preset in ONE_THREAD_PRESETS:
            config = load_preset(preset)
            warm_up(config)
            floor_ms = float(np.mean(floor_times(config, pictures)[:, 1]))
            rows.append({'preset': preset, 'floor_ms': round(floor_ms, 2),
                         'ours_ms': [asdict(row) for row in stage_times(config, pictures)]})
        return rows


def reported(frames: int) -> list[dict[str, Any]]:
    """Our stages beside those of the report's tables, on flights of the data sets' image sizes."""
    rows = []
    for table in REPORTED:
        config = load_preset(table.preset)
        warm_up(config)
        times = stage_times(config, flight(FlightConfig(width=table.width, height=table.height, frames=frames)))
        rows.append({'name': table.name, 'size': f'{table.width}x{table.height}',
                     'published_ms': table.published_ms, 'ours_ms': [asdict(row) for row in times]})
    return rows


def floors(preset: str, frames: int) -> list[Ratio]:
    """The whole pipeline against the OpenCV calls that cannot be avoided, interleaved, at every size."""
    config = not_enlarging(load_preset(preset))
    warm_up(config)
    return [Ratio.of(f'{width}x{height}', floor_times(
        config, flight(FlightConfig(width=width, height=height, frames=frames)))) for width, height in SIZES]


def backgrounds(preset: str, frames: int) -> list[Ratio]:
    """The pipeline with a background in three dimensions against the planar one, interleaved, at every size."""
    config = not_enlarging(load_preset(preset))
    warm_up(config)
    return [Ratio.of(f'{width}x{height}', background_times(
        config, flight(FlightConfig(width=width, height=height, frames=frames)))) for width, height in SIZES]


def codec_times() -> list[Timing]:
    """A 1280x720 bgr8 image to a message and back, milliseconds over ``CODEC_ROUNDS`` calls of each.

    Raises: BackendError where ROS 2 is not installed.
    """
    try:
        from motion_detect_ros.bridge.images import header_of, image_from_msg, image_to_msg
    except ModuleNotFoundError as error:
        raise BackendError(f'bench: expected an installation of ROS 2, but {error.name} is missing') from None
    image = np.zeros((720, 1280, 3), np.uint8)
    header = header_of(0, 'camera')
    message = image_to_msg(image, header)
    return [Timing.of(name, [elapsed_ms(action) for _ in range(CODEC_ROUNDS)]) for name, action in (
        ('to message', lambda: image_to_msg(image, header)), ('from message', lambda: image_from_msg(message)))]
