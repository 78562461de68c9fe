"""Where the camera is and where it looks, frame by frame."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from motion_detect_ros.core.errors import ConfigError
from motion_detect_ros.core.types import CameraModel, DoubleArray
from motion_detect_ros.sources.synthetic.config import MIN_ALTITUDE_M, FlightConfig

_TURN_PERIOD_S = 14.0
_CLIMB_PERIOD_S = 24.0
_ZOOM_PERIOD_S = 9.0
_SHAKE_LOW_HZ, _SHAKE_HIGH_HZ = 0.5, 6.0
_SHAKE_WAVES = 6
#: Steps of the position integral per frame; the course bends so little that the midpoint rule is exact to micrometres.
_SUBSTEPS = 16


@dataclass(frozen=True)
class CameraPose:
    """One camera: X_camera = rotation @ (X_world - centre); optical frame x right, y down, z forward, metres.

    ``rotation``, ``intrinsic``: (3, 3) float64; ``centre``: (3,) float64, metres.
    """

    rotation: DoubleArray
    centre: DoubleArray
    intrinsic: DoubleArray
    time_s: float

    def model(self, width: int, height: int) -> CameraModel:
        """Calibration for an image of ``width`` x ``height`` pixels."""
        k = self.intrinsic
        return CameraModel(width, height, float(k[0, 0]), float(k[1, 1]), float(k[0, 2]), float(k[1, 2]))

    def ground_to_pixel(self) -> DoubleArray:
        """(3, 3) float64 homography from ground (x, y, 1) in metres to homogeneous pixels.

        Source: Hartley & Zisserman 2004, section 8.1: K [r1 r2 t] for the plane z = 0.
        """
        columns = np.column_stack([self.rotation[:, 0], self.rotation[:, 1], -self.rotation @ self.centre])
        return np.asarray(self.intrinsic @ columns)


class CameraPath:
    """The poses of a flight, from frame -1 (the instant before the first picture) on."""

    def __init__(self, config: FlightConfig) -> None:
        self._config = config
        self._rng_shake = _shake_waves(config)
        self._centres = _integrate(config)
        lowest = float(self._centres[:, 2].min())
        floor_m = MIN_ALTITUDE_M / 2
        if lowest < floor_m:
            raise ConfigError(f'flight path: expected at least {floor_m:g} m over the ground, got {lowest:.1f} m')

    def pose(self, index: int) -> CameraPose:
        """The camera at frame ``index`` (-1 to frames - 1)."""
        config, time_s = self._config, index / self._config.fps
        rotation = _small_rotation(self._shake(time_s)) @ look_rotation(
            float(_yaw(config, np.array(time_s))), math.radians(config.pitch_deg))
        focal = config.focal_px * (1 + config.zoom_share * math.sin(2 * math.pi * time_s / _ZOOM_PERIOD_S))
        intrinsic = np.array([
            [focal, 0, (config.width - 1) / 2], [0, focal, (config.height - 1) / 2], [0, 0, 1]])
        return CameraPose(rotation, self._centres[index + 1], intrinsic, time_s)

    def _shake(self, time_s: float) -> DoubleArray:
        """(3,) rotation vector, radians: a sum of waves, so that any frame is reached without the ones before."""
        frequency, phase, weight = self._rng_shake
        waves = (weight * np.sin(2 * np.pi * frequency * time_s + phase)).sum(axis=1)
        return np.asarray(math.radians(self._config.shake_deg) * waves)


def look_rotation(yaw: float, pitch: float) -> DoubleArray:
    """(3, 3) world -> optical rotation of a level camera looking along ``yaw``, ``pitch`` below the horizon (rad)."""
    forward = np.array([math.cos(yaw) * math.cos(pitch), math.sin(yaw) * math.cos(pitch), -math.sin(pitch)])
    right = np.array([math.sin(yaw), -math.cos(yaw), 0.0])
    return np.stack([right, np.cross(forward, right), forward])


def _small_rotation(vector: DoubleArray) -> DoubleArray:
    """Rotation matrix of a rotation vector (Rodrigues' formula)."""
    angle = float(np.linalg.norm(vector))
    if angle == 0.0:
        return np.eye(3)
    x, y, z = vector / angle
    cross = np.array([[0, -z, y], [z, 0, -x], [-y, x, 0]])
    return np.asarray(np.eye(3) + math.sin(angle) * cross + (1 - math.cos(angle)) * cross @ cross)


def _shake_waves(config: FlightConfig) -> tuple[DoubleArray, DoubleArray, DoubleArray]:
    """Frequencies (Hz), phases and weights, (3, waves) each; the sum of a row has variance 1."""
    rng = np.random.default_rng([config.seed, 1])
    shape = (3, _SHAKE_WAVES)
    frequency = rng.uniform(_SHAKE_LOW_HZ, _SHAKE_HIGH_HZ, shape)
    weight = 1 / frequency  # hand and wind shake falls with frequency
    weight *= np.sqrt(2 / (weight ** 2).sum(axis=1, keepdims=True))
    return frequency, rng.uniform(0, 2 * np.pi, shape), weight


def _yaw(config: FlightConfig, time_s: DoubleArray) -> DoubleArray:
    """Course, radians, counter-clockwise from east: its rate is ``turn_deg_s`` sin(w t)."""
    pulse = 2 * math.pi / _TURN_PERIOD_S
    swing = math.radians(config.turn_deg_s) / pulse
    return np.asarray(math.radians(config.heading_deg) + swing * (1 - np.cos(pulse * time_s)))


def _velocity(config: FlightConfig, time_s: DoubleArray) -> DoubleArray:
    """(n, 3) velocity of the camera, m/s: course, descent and climb, and the approach along the level optical axis."""
    yaw, pitch = _yaw(config, time_s), math.radians(config.pitch_deg)
    flat = config.speed_m_s + config.approach_m_s * math.cos(pitch)
    climb = -config.climb_m_s * np.cos(2 * np.pi * time_s / _CLIMB_PERIOD_S)
    return np.stack([flat * np.cos(yaw), flat * np.sin(yaw), climb - config.approach_m_s * math.sin(pitch)], axis=1)


def _integrate(config: FlightConfig) -> DoubleArray:
    """(frames + 1, 3) positions of frames -1 .. frames - 1; frame 0 is over the origin."""
    step_s = 1 / config.fps / _SUBSTEPS
    middles: DoubleArray = (np.arange(config.frames * _SUBSTEPS, dtype=np.float64) + 0.5) * step_s - 1 / config.fps
    moved = np.cumsum(_velocity(config, middles) * step_s, axis=0)[_SUBSTEPS - 1::_SUBSTEPS]
    positions = np.concatenate([np.zeros((1, 3)), moved])
    return np.asarray(positions - positions[1] + [0.0, 0.0, config.altitude_m])
