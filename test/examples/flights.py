"""The flights on which the examples are tried, what they are given, and what is true."""

from __future__ import annotations

import dataclasses
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from motion_detect_ros.cli.planner import Received
from motion_detect_ros.core.types import RecordArray
from motion_detect_ros.sources.synthetic import FlightConfig, SyntheticFlight
from motion_detect_ros.sources.synthetic.camera_path import CameraPath
from motion_detect_ros.sources.synthetic.config import ObjectSpec

EXAMPLES = Path(__file__).resolve().parents[2] / 'examples'

#: The built-in flight of the demo, its first three seconds.
TOWN = FlightConfig(frames=60)
#: Straight down onto a square that drives to the right, at 10 m/s: 5 s before contact at the start, 2.8 s at the end.
DESCENT = dataclasses.replace(
    FlightConfig.approach(10.0, frames=45), altitude_m=50.0,
    objects=(ObjectSpec('box', -3.0, 2.0, 0.0, 4.0, 5.0, 5.0, 1.0),))

#: What is given to the examples, so that every one has something to do; the tests compute with the same numbers.
HORIZON_S, RANGE_M, GAIN, LOST_S = 3.6, 7.0, 0.5, 0.3
RUN = {
    'planner': (f'horizon_s:={HORIZON_S}',),
    'follow': (f'gain:={GAIN}', f'lost_s:={LOST_S}'),
    'bearings_to_points': (f'range_m:={RANGE_M}',),
    'autopilot_frames': (f'range_m:={RANGE_M}', f'camera_pitch_deg:={TOWN.pitch_deg}'),
}


@dataclass(frozen=True)
class Flown:
    """One flight: what the detector published, and what the examples answered, by topic."""

    config: FlightConfig
    bag: Path
    detections: tuple[Received, ...]
    answers: dict[str, list[Any]]


def truth_rays(config: FlightConfig, index: int) -> tuple[RecordArray, np.ndarray, np.ndarray]:
    """Frame ``index``: true boxes of what moves, the rays to their middles in the optical frame, and in the world.

    rays: (n, 3) unit vectors by the camera's true matrix; the world is east, north, up.
    """
    frame, pose = SyntheticFlight(config).frame(index), CameraPath(config).pose(index)
    boxes = frame.truth[frame.truth['moving'] == 1]
    middles = np.stack([boxes['x'] + (boxes['w'] - 1) / 2, boxes['y'] + (boxes['h'] - 1) / 2, np.ones(len(boxes))])
    rays = (np.linalg.inv(pose.intrinsic) @ middles).T
    rays /= np.linalg.norm(rays, axis=1, keepdims=True)
    return boxes, rays, rays @ pose.rotation
