"""Flights that measure a limit: square objects of one size and speed under a camera that pans or turns steadily.

The camera looks straight down on a textured field, with the noise, motion blur and exposure drift of the default
flight. Objects move across the camera's course, each in a lane of its own, so that none hides another.
"""

from __future__ import annotations

import dataclasses
import math
from collections import Counter
from dataclasses import dataclass

import numpy as np

from motion_detect_ros.core.config import PipelineConfig
from motion_detect_ros.core.errors import ConfigError
from motion_detect_ros.core.pipeline import MotionPipeline
from motion_detect_ros.results.metrics import boxes_of, judge_frame
from motion_detect_ros.sources.synthetic import FlightConfig, ObjectSpec, SyntheticFlight
from motion_detect_ros.sources.synthetic.config import SINGLE_HEIGHT_M

WIDTH_PX, HEIGHT_PX = 640, 720
#: Length of a measured flight, and how long an object must have been in view to count, frames.
FRAMES, WARM_UP_FRAMES = 30, 8
#: Frame of a flight at which the camera of ``FlightConfig`` turns fastest, its 14 s S-course at 20 frames/s.
FASTEST_TURN_FRAME = 70
#: Distance of two lanes: at least this, and at least so many sizes; farthest from the middle column half way, pixels.
LANE_PX, LANE_SIZES, JITTER_PX = 90.0, 2.0, 40.0
#: A turning picture shows only what is nearer to its middle than this for all of its turn, pixels.
TURN_RADIUS_PX = 300.0
IOU = 0.3


@dataclass(frozen=True)
class Cell:
    """What is flown. ``size_px``: side of the objects; ``speed_px``: over the ground, ``pan_px``: of the ground down
    the image, both pixels/frame; ``turn_deg``: of the image about its middle, degrees/frame.
    """

    size_px: float
    speed_px: float
    pan_px: float = 0.0
    turn_deg: float = 0.0
    seed: int = 1

    def frames(self) -> range:
        """Which frames of the flight are flown."""
        start = FASTEST_TURN_FRAME - FRAMES // 2 if self.turn_deg else 0
        return range(start, start + FRAMES)


@dataclass(frozen=True)
class Found:
    """Boxes of movers long enough in view, and how many of them were hit; false boxes among all frames counted."""

    wanted: int
    hits: int
    false: int


def make_flight(cell: Cell) -> FlightConfig:
    """The flight of a cell. Raises: ConfigError for a camera that moves and turns, or too fast."""
    if cell.pan_px and cell.turn_deg:
        raise ConfigError(f'a camera that pans or turns expected, got {cell.pan_px:g} px and {cell.turn_deg:g} degrees')
    plain, usual = FlightConfig.single(cell.size_px, cell.speed_px, cell.pan_px, seed=cell.seed), FlightConfig()
    return dataclasses.replace(
        plain, width=WIDTH_PX, height=HEIGHT_PX, frames=cell.frames().stop, turn_deg_s=cell.turn_deg * plain.fps,
        blur=usual.blur, exposure_drift=usual.exposure_drift, objects=tuple(_objects(cell, plain)))


def _objects(cell: Cell, flight: FlightConfig) -> list[ObjectSpec]:
    """Objects in lanes from the bottom of the first image to the top of the last one, going right and left in turn."""
    rng = np.random.default_rng([cell.seed, 7])
    m_per_px = flight.altitude_m / flight.focal_px
    top_m_per_px = (flight.altitude_m - SINGLE_HEIGHT_M) / flight.focal_px
    side_m, speed_m_s = cell.size_px * top_m_per_px, cell.speed_px * top_m_per_px * flight.fps
    lane_px = max(LANE_PX, LANE_SIZES * cell.size_px)
    reach_px = TURN_RADIUS_PX if cell.turn_deg else HEIGHT_PX / 2
    first = int(rng.integers(2))
    lanes = np.arange(-reach_px + lane_px / 2, reach_px + cell.pan_px * FRAMES, lane_px)
    return [_object(lane_px_ahead * m_per_px, 180.0 * ((number + first) % 2), speed_m_s, side_m,
                    float(rng.uniform(-JITTER_PX, JITTER_PX)) * m_per_px, _middle_s(lane_px_ahead, cell, flight.fps))
            for number, lane_px_ahead in enumerate(lanes.tolist())]


def _object(y_m: float, heading_deg: float, speed_m_s: float, side_m: float, x_m: float, when_s: float) -> ObjectSpec:
    """A box in the lane ``y_m`` that is at ``x_m`` at ``when_s``."""
    start_m = x_m - speed_m_s * when_s * math.cos(math.radians(heading_deg))
    return ObjectSpec('box', start_m, y_m, heading_deg, speed_m_s, side_m, side_m, SINGLE_HEIGHT_M)


def _middle_s(ahead_px: float, cell: Cell, fps: float) -> float:
    """When a lane is nearest to the middle of the image, seconds."""
    frames = cell.frames()
    middle = (frames.start + frames.stop - 1) / 2
    if cell.pan_px:
        middle = min(max(ahead_px / cell.pan_px, frames.start + FRAMES / 4), frames.stop - FRAMES / 4)
    return middle / fps


def fly(cell: Cell, config: PipelineConfig) -> Found:
    """The detector over the flight of a cell."""
    flight = SyntheticFlight(make_flight(cell))
    pipeline, seen, found = MotionPipeline(config, flight.camera), Counter[int](), Found(0, 0, 0)
    for index in cell.frames():
        frame = flight.frame(index)
        records = pipeline.process(frame.image, frame.stamp_ns).detections
        verdict = judge_frame(frame.truth, boxes_of(records), IOU)
        seen.update(verdict.wanted['id'].tolist())
        counts = np.array([seen[ident] > WARM_UP_FRAMES for ident in verdict.wanted['id'].tolist()], bool)
        false = int((~verdict.hit & ~verdict.ignored).sum()) if index - cell.frames().start >= WARM_UP_FRAMES else 0
        found = Found(found.wanted + int(counts.sum()), found.hits + int((verdict.found & counts).sum()),
                      found.false + false)
    return found
