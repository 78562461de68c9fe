"""``bench``: how the time of a frame grows with pixels, objects, ART2 neurons and grid cells."""

from __future__ import annotations

import math
import time
from collections.abc import Iterator
from dataclasses import dataclass, replace
from functools import partial
from typing import Any

import numpy as np

from motion_detect_ros.benchmarks.bench_timing import Frames, elapsed_ms, flight
from motion_detect_ros.core.clustering.art2 import make_art2
from motion_detect_ros.core.config import PipelineConfig
from motion_detect_ros.core.pipeline import MotionPipeline, warm_up
from motion_detect_ros.presets import load_preset
from motion_detect_ros.sources.synthetic import FlightConfig, ObjectSpec

MEGAPIXELS = (0.1, 0.25, 0.5, 1.0, 2.0, 4.0, 8.0)
OBJECTS = (0, 5, 10, 25, 50, 100, 200)
NEURONS = (5, 10, 15, 25, 50, 75, 100)
CELL_PX = (2, 3, 4, 6, 8, 12, 16)
#: Frames of one point of a curve, and how many of them at the start are not timed.
POINT_FRAMES, POINT_WARM = 10, 5
#: Cars, of 43 pixels, drive over a field in rows of so many; the rows' speeds differ, so that none of them outnumbers
#: the ground.
FIELD_PX, FIELD_M, FIELD_COLUMNS = (1600, 900), (100.0, 56.0), 20
SIDE_M, ROW_SPEEDS_M_S = 2.7, (6.0, -7.0, 8.0, -9.0)
#: Residual motions for ART2 alone: cells, and the circle of speeds they lie on, noise units.
VECTORS, FASTEST = 30000, 60.0


@dataclass(frozen=True)
class Point:
    """``x``: what was varied; ``ms``: median times by name; ``note``: what came of it (objects found, neurons used)."""

    x: float
    ms: dict[str, float]
    note: int


@dataclass(frozen=True)
class Curve:
    """``slopes``: exponent of a power law fitted to every series, least squares of log time on log x, over x > 0."""

    name: str
    unit: str
    counted: str
    points: list[Point]

    @property
    def slopes(self) -> dict[str, float]:
        """Series name -> exponent."""
        return {name: slope([point.x for point in self.points], [point.ms[name] for point in self.points])
                for name in self.points[0].ms}


def slope(x: list[float], y: list[float]) -> float:
    """Exponent b of the power law y = a x^b, over the pairs that have a logarithm; NaN from under two of them."""
    pairs = [(math.log(a), math.log(b)) for a, b in zip(x, y, strict=True) if a > 0.0 and b > 0.0]
    if len(pairs) < 2:
        return math.nan
    log_x, log_y = np.array(pairs).T
    return round(float(np.polyfit(log_x, log_y, 1)[0]), 2)


def curves(preset: str) -> list[Curve]:
    """All four."""
    config = load_preset(preset)
    warm_up(config)
    return [
        Curve('pixels', 'megapixels at working resolution', 'objects', [*_over_pixels(config)]),
        Curve('objects', 'moving objects in the picture', 'objects', [*_over_objects(config)]),
        Curve('neurons', 'ART2 neurons at most', 'neurons', [*_over_neurons(config)]),
        Curve('cells', 'grid cells', 'objects', [*_over_cells(config)]),
    ]


def as_json(curve: Curve) -> dict[str, Any]:
    """Rows and exponents."""
    return {'name': curve.name, 'unit': curve.unit, 'counted': curve.counted, 'slopes': curve.slopes,
            'points': [vars(point) for point in curve.points]}


def _over_pixels(config: PipelineConfig) -> Iterator[Point]:
    """The same flight, read out finer and finer and processed at full resolution."""
    for megapixels in MEGAPIXELS:
        width = 16 * round(math.sqrt(megapixels * 1e6 * 16 / 9) / 16)
        height = width * 9 // 16
        frames = flight(FlightConfig(
            width=width, height=height, frames=POINT_FRAMES, focal_px=FlightConfig.focal_px * width / 960))
        full = replace(config, preprocessing=replace(config.preprocessing, max_width_px=width))
        yield _point(width * height / 1e6, full, frames)


def _over_objects(config: PipelineConfig) -> Iterator[Point]:
    """Small cars that drive over a field, seen from straight above."""
    width, height = FIELD_PX
    bare = replace(FlightConfig.approach(0.0, frames=POINT_FRAMES), width=width, height=height, altitude_m=50.0)
    full = replace(config, preprocessing=replace(config.preprocessing, max_width_px=width))
    for count in OBJECTS:
        yield _point(count, full, flight(replace(bare, objects=cars(count))))


def cars(count: int) -> tuple[ObjectSpec, ...]:
    """Rows of cars, each row with a speed of its own, left and right in turn."""
    columns, rows = min(count, FIELD_COLUMNS), -(-count // FIELD_COLUMNS)
    speeds = [ROW_SPEEDS_M_S[index // FIELD_COLUMNS % len(ROW_SPEEDS_M_S)] for index in range(count)]
    return tuple(ObjectSpec(
        'car', FIELD_M[0] * ((index % columns + 0.5) / columns - 0.5),
        FIELD_M[1] * ((index // FIELD_COLUMNS + 0.5) / rows - 0.5),
        0.0 if speed > 0.0 else 180.0, abs(speed), SIDE_M, SIDE_M, 0.3) for index, speed in enumerate(speeds))


def _over_neurons(config: PipelineConfig) -> Iterator[Point]:
    """ART2 alone, on motions of every direction and speed, with as many neurons as it may have."""
    vectors = _motions()
    for count in NEURONS:
        art2 = make_art2(replace(config.art2, initial_neurons=count, max_neurons=count, vigilance=0.9))
        times = [elapsed_ms(partial(art2.partial_fit, vectors)) for _ in range(POINT_FRAMES)]
        yield Point(count, {'art2': round(float(np.median(times[POINT_WARM:])), 3)}, len(art2.prototypes))


def _motions() -> Any:
    random = np.random.default_rng(1)
    angle, speed = random.uniform(0.0, 2.0 * np.pi, VECTORS), random.uniform(0.0, FASTEST, VECTORS)
    return np.stack([speed * np.cos(angle), speed * np.sin(angle)], axis=1).astype(np.float32)


def _over_cells(config: PipelineConfig) -> Iterator[Point]:
    frames = flight(FlightConfig(frames=POINT_FRAMES))
    height, width = frames[0][0].shape[:2]
    for cell_px in sorted(CELL_PX, reverse=True):
        finer = replace(config, optical_flow=replace(config.optical_flow, grid_px=cell_px))
        yield _point(round(width / cell_px) * round(height / cell_px), finer, frames)


def _point(x: float, config: PipelineConfig, frames: Frames) -> Point:
    pipeline, results, processor = MotionPipeline(config), [], []
    for image, stamp_ns in frames:
        start = time.process_time()
        results.append(pipeline.process(image, stamp_ns))
        pipeline.wait()
        processor.append(1e3 * (time.process_time() - start))
    results, processor = results[POINT_WARM:], processor[POINT_WARM:]
    ms = {name: round(float(np.median([getattr(result.times_ms, name) for result in results])), 3)
          for name in ('total', 'ego_motion', 'optical_flow', 'clustering')}
    ms['processor'] = round(float(np.median(processor)), 3)
    return Point(round(x, 4), ms, int(np.median([len(result.detections) for result in results])))
