"""What a synthetic flight looks like: every knob of the camera, the town and the sensor."""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

from motion_detect_ros.core.errors import ConfigError
from motion_detect_ros.core.settings import setting

#: The camera never comes closer to the ground than this, metres: roofs must stay below the lens.
MIN_ALTITUDE_M = 30.0

#: Height of the object of ``FlightConfig.single``, metres: low, so that its top moves as the ground under it does.
SINGLE_HEIGHT_M = 0.3

KINDS = ('car', 'person', 'box')


@dataclass(frozen=True)
class ObjectSpec:
    """One object placed by hand: it starts at (x, y) at frame 0 and keeps its heading and speed.

    World frame: x east, y north, z up, metres, origin under the camera at frame 0. ``heading_deg``: 0 = east,
    counter-clockwise. ``length_m`` is along the heading, ``width_m`` across it.
    """

    kind: str
    x_m: float
    y_m: float
    heading_deg: float = 0.0
    speed_m_s: float = 0.0
    length_m: float = 4.4
    width_m: float = 1.8
    height_m: float = 1.5


@dataclass(frozen=True)
class FlightConfig:
    """A seeded flight over a town that repeats every 256 m. The same config always gives the same bytes.

    Each body is drawn once, in the copy nearest to the view: a view that reaches over 128 m from its middle (low
    pitch, short focal length, great height together) shows bare ground in its far corners.
    """

    width: int = setting(960, 'image width', low=64, high=4096, unit='px')
    height: int = setting(540, 'image height', low=64, high=4096, unit='px')
    fps: float = setting(20.0, 'frame rate', low=0.5, high=1000.0, unit='1/s')
    frames: int = setting(120, 'length of the flight', low=1, high=100000, unit='frames')
    seed: int = setting(1, 'everything random follows from it', low=0, high=2**31 - 1)
    start_stamp_ns: int = setting(1_700_000_000_000_000_000, 'stamp of frame 0', low=0, unit='ns')

    altitude_m: float = setting(50.0, 'height of the camera at frame 0', low=MIN_ALTITUDE_M, high=300.0, unit='m')
    speed_m_s: float = setting(8.0, 'horizontal speed of the camera', low=0.0, high=60.0, unit='m/s')
    heading_deg: float = setting(24.0, 'flight direction at frame 0, 0 = east, counter-clockwise',
                                 low=-360.0, high=360.0, unit='deg')
    pitch_deg: float = setting(54.0, 'optical axis below the horizon, 90 = straight down',
                               low=35.0, high=90.0, unit='deg')
    turn_deg_s: float = setting(4.0, 'largest yaw rate of the S-shaped course', low=0.0, high=90.0, unit='deg/s')
    climb_m_s: float = setting(1.0, 'largest vertical speed; the flight begins with a descent',
                               low=0.0, high=20.0, unit='m/s')
    approach_m_s: float = setting(0.0, 'constant speed along the optical axis on top of the flight',
                                  low=-60.0, high=60.0, unit='m/s')
    shake_deg: float = setting(0.06, 'standard deviation of the shake of each camera angle',
                               low=0.0, high=5.0, unit='deg')
    focal_px: float = setting(720.0, 'focal length at zoom 1', low=50.0, high=20000.0, unit='px')
    zoom_share: float = setting(0.04, 'amplitude of the slow zoom, share of the focal length', low=0.0, high=0.5)

    blur: float = setting(0.3, 'exposure time, share of the frame interval (motion blur)', low=0.0, high=1.0)
    noise_sigma: float = setting(2.0, 'standard deviation of the sensor noise', low=0.0, high=50.0, unit='grey levels')
    exposure_drift: float = setting(0.06, 'amplitude of the slow change of brightness, share', low=0.0, high=0.5)

    ground: str = setting('town', 'what the ground is painted as', choices=('town', 'field'))
    ground_contrast: float = setting(1.0, 'contrast of the ground texture, 0 = uniform grey', low=0.0, high=1.0)
    cars: int = setting(40, 'driving cars in 256 m x 256 m', low=0, high=200)
    parked_cars: int = setting(70, 'parked cars in 256 m x 256 m', low=0, high=300)
    people: int = setting(110, 'people in 256 m x 256 m, one in eight stands still', low=0, high=500)
    buildings: int = setting(60, 'buildings in 256 m x 256 m', low=0, high=81)
    trees: int = setting(110, 'trees in 256 m x 256 m', low=0, high=400)
    objects: tuple[ObjectSpec, ...] = ()

    def __post_init__(self) -> None:
        """Raises: ConfigError for a value outside its range or an unknown kind of object."""
        for item in dataclasses.fields(self):
            _check(item.name, getattr(self, item.name), item.default, item.metadata)
        for spec in self.objects:
            if spec.kind not in KINDS:
                raise ConfigError(f'objects: kind expected one of {", ".join(KINDS)}, got {spec.kind!r}')
            if min(spec.length_m, spec.width_m, spec.height_m) <= 0:
                raise ConfigError(f'objects: sizes expected over 0 m, got {spec}')

    @classmethod
    def single(
        cls, size_px: float, speed_px: float, camera_px: float = 0.0, *, direction_deg: float = 0.0,
        frames: int = 30, seed: int = 1, noise_sigma: float = 2.0, ground_contrast: float = 1.0,
    ) -> FlightConfig:
        """One square object over a flat field, seen from straight above: a cell of an accuracy grid.

        size_px: side of the object in the image, pixels; speed_px: its speed over the ground, pixels/frame;
        camera_px: speed of the ground down the image, pixels/frame; direction_deg: where the object goes,
        0 = right, 90 = down. Half way through the flight the object is in the middle of the image.
        Raises: ConfigError where a derived camera speed or size leaves its range.
        """
        view = cls(speed_m_s=0.0)
        ground_m_per_px = view.altitude_m / view.focal_px
        top_m_per_px = (view.altitude_m - SINGLE_HEIGHT_M) / view.focal_px
        half_s = (frames - 1) / 2 / view.fps
        camera_m_s, object_m_s = camera_px * ground_m_per_px * view.fps, speed_px * top_m_per_px * view.fps
        # the image's top points along the flight (heading 90 = north), its right therefore east
        heading = -math.radians(direction_deg)
        thing = ObjectSpec(
            'box', -object_m_s * half_s * math.cos(heading), (camera_m_s - object_m_s * math.sin(heading)) * half_s,
            -direction_deg, object_m_s, size_px * top_m_per_px, size_px * top_m_per_px, SINGLE_HEIGHT_M)
        return _bare(cls(
            frames=frames, seed=seed, speed_m_s=camera_m_s, noise_sigma=noise_sigma,
            ground_contrast=ground_contrast, objects=(thing,)))

    @classmethod
    def approach(cls, closing_m_s: float = 5.0, *, frames: int = 60, seed: int = 1) -> FlightConfig:
        """A straight descent onto four standing cars: nothing turns, time to contact is depth / ``closing_m_s``.

        Raises: ConfigError where the descent is outside the range of ``approach_m_s``; the flight itself
        refuses one that ends too low.
        """
        cars = tuple(ObjectSpec('car', x, y, 30.0) for x, y in ((-9.0, 5.0), (8.0, 6.0), (-7.0, -6.0), (9.0, -5.0)))
        return _bare(cls(
            frames=frames, seed=seed, altitude_m=60.0, speed_m_s=0.0, approach_m_s=closing_m_s, objects=cars))


def _bare(config: FlightConfig) -> FlightConfig:
    """The same flight straight ahead and straight down over an empty field."""
    return dataclasses.replace(
        config, heading_deg=90.0, pitch_deg=90.0, turn_deg_s=0.0, climb_m_s=0.0, shake_deg=0.0, zoom_share=0.0,
        blur=0.0, exposure_drift=0.0, ground='field', cars=0, parked_cars=0, people=0, buildings=0, trees=0)


def _check(name: str, value: Any, default: Any, metadata: Mapping[str, Any]) -> None:
    """Raises: ConfigError where ``value`` is of another type than its default or leaves the field's range."""
    if not metadata:
        return
    expected = (int, float) if type(default) is float else (type(default),)
    if type(value) not in expected:
        raise ConfigError(f'{name}: expected {type(default).__name__}, got {type(value).__name__} {value!r}')
    choices, low, high = metadata['choices'], metadata['low'], metadata['high']
    if choices and value not in choices:
        raise ConfigError(f'{name}: expected one of {", ".join(choices)}, got {value!r}')
    if (low is not None and not value >= low) or (high is not None and not value <= high):
        raise ConfigError(f'{name}: expected {low} to {high}, got {value!r}')
