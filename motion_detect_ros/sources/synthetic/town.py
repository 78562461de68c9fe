"""The inhabitants of the plan: houses, trees, cars and people, each with its place and its way."""

from __future__ import annotations

import math
from dataclasses import dataclass, field

import numpy as np

from motion_detect_ros.core.types import DoubleArray
from motion_detect_ros.sources.synthetic import layout, solids
from motion_detect_ros.sources.synthetic.config import FlightConfig, ObjectSpec
from motion_detect_ros.sources.synthetic.layout import PERIOD_M, Plan
from motion_detect_ros.sources.synthetic.solids import Patches, Vector
from motion_detect_ros.sources.synthetic.textures import Material

#: Reflectances, blue green red.
_PAINTS: tuple[Vector, ...] = (
    (0.95, 0.95, 0.95), (0.75, 0.75, 0.72), (0.16, 0.16, 0.18), (0.22, 0.18, 0.72), (0.62, 0.30, 0.16),
    (0.35, 0.36, 0.38), (0.30, 0.62, 0.80), (0.28, 0.36, 0.20))
_VAN_PAINTS: tuple[Vector, ...] = ((0.95, 0.95, 0.95), (0.75, 0.75, 0.72), (0.55, 0.32, 0.20), (0.25, 0.70, 0.85))
_WALLS: tuple[Vector, ...] = ((0.80, 0.92, 0.97), (0.72, 0.80, 0.88), (0.92, 0.92, 0.92), (0.62, 0.76, 0.86))
_ROOFS: tuple[Vector, ...] = ((0.28, 0.36, 0.72), (0.30, 0.32, 0.45), (0.42, 0.42, 0.44), (0.22, 0.30, 0.58))
_CLOTHES: tuple[Vector, ...] = (
    (0.9, 0.9, 0.9), (0.14, 0.14, 0.16), (0.2, 0.2, 0.8), (0.7, 0.35, 0.15), (0.15, 0.6, 0.75), (0.35, 0.3, 0.25))
_SKIN: Vector = (0.50, 0.62, 0.84)
_LEAVES: tuple[Vector, ...] = ((0.20, 0.50, 0.36), (0.24, 0.58, 0.46), (0.18, 0.42, 0.34))

_CAR_SPEED_M_S = (6.0, 13.0)
_WALK_SPEED_M_S = (1.0, 1.9)
_STANDING_SHARE = 1 / 8
_VAN_SHARE = 0.15
#: Two movers whose centres come closer than this would run into each other, metres (both cars, otherwise).
_CAR_GAP_M, _PERSON_GAP_M = 7.0, 3.2
#: Collisions are looked for this far ahead, seconds; later ones in a longer flight are left to happen.
_COLLISION_HORIZON_S = 20.0
_COLLISION_STEP_S = 0.2
_TRIES = 12


@dataclass(frozen=True)
class Body:
    """One rigid thing: at (x, y), metres, at frame 0; ``heading`` rad, ``speed`` m/s along it.

    ``size``: length, width, height, metres; ``ident``: id in the truth, 0 = scenery.
    """

    patches: Patches
    x: float
    y: float
    heading: float
    size: tuple[float, float, float]
    speed: float = 0.0
    ident: int = 0


@dataclass(frozen=True)
class Town:
    """All bodies, scenery first, and the plan they stand on."""

    plan: Plan
    bodies: tuple[Body, ...] = field(default=())


def build_town(config: FlightConfig) -> Town:
    """Everything that stands on the ground of ``config``; ids count from 1: hand-placed, cars, parked, people."""
    plan = layout.make_plan(config.seed)
    rng = np.random.default_rng([config.seed, 5])
    scenery = _buildings(plan, config.buildings, rng)
    scenery += _trees(plan, config.trees, scenery, rng)
    movers = [_placed(spec, rng) for spec in config.objects]
    parked = _parked(plan, config.parked_cars, rng)
    horizon = min(_COLLISION_HORIZON_S, config.frames / config.fps)
    traffic = _Traffic(np.arange(0.0, horizon + _COLLISION_STEP_S, _COLLISION_STEP_S))
    cars = _cars(plan, config.cars, traffic, rng)
    people = _people(plan, config.people, traffic, rng)
    known = [_numbered(body, ident + 1) for ident, body in enumerate(movers + cars + parked + people)]
    return Town(plan, tuple(scenery + known))


class _Traffic:
    """Movers so far, sampled over time, to keep the next one from running into them."""

    def __init__(self, times_s: DoubleArray) -> None:
        self._times = times_s
        self._paths: list[DoubleArray] = []
        self._gaps: list[float] = []

    def admit(self, body: Body, gap_m: float) -> bool:
        """Take ``body`` in unless it comes closer than the gap to one that is in already."""
        ahead = np.array([math.cos(body.heading), math.sin(body.heading)])
        path = np.array([body.x, body.y]) + body.speed * self._times[:, None] * ahead
        if self._paths:
            apart = np.stack(self._paths) - path
            apart -= PERIOD_M * np.rint(apart / PERIOD_M)
            nearest = np.sqrt((apart ** 2).sum(axis=2).min(axis=1))
            both = np.minimum(np.array(self._gaps), gap_m)
            if (nearest < both).any():
                return False
        self._paths.append(path)
        self._gaps.append(gap_m)
        return True


def _numbered(body: Body, ident: int) -> Body:
    return Body(body.patches, body.x, body.y, body.heading, body.size, body.speed, ident)


def _choice(rng: np.random.Generator, values: tuple[Vector, ...]) -> Vector:
    picked = values[int(rng.integers(len(values)))]
    jitter = rng.uniform(0.9, 1.05)
    return (picked[0] * jitter, picked[1] * jitter, picked[2] * jitter)


def _placed(spec: ObjectSpec, rng: np.random.Generator) -> Body:
    size = (spec.length_m, spec.width_m, spec.height_m)
    if spec.kind == 'car':
        shape = solids.car(*size, _choice(rng, _PAINTS))
    elif spec.kind == 'person':
        shape = solids.person(spec.height_m, _choice(rng, _CLOTHES), _choice(rng, _CLOTHES), _SKIN)
        size = (solids.SHOULDER_DEPTH_M, solids.SHOULDER_WIDTH_M, spec.height_m)
    else:
        shape = solids.crate(*size, (0.75, 0.95, 1.1))
    return Body(shape, spec.x_m, spec.y_m, math.radians(spec.heading_deg), size, spec.speed_m_s)


def _buildings(plan: Plan, count: int, rng: np.random.Generator) -> list[Body]:
    plots = [(block.kind, x, y, room_x, room_y) for block in plan.blocks if block.kind in ('houses', 'flats')
             for x, y, room_x, room_y in layout.lots(block)]
    order = rng.permutation(len(plots))[:count]
    return [_building(kind, x, y, room_x, room_y, rng) for kind, x, y, room_x, room_y in (plots[i] for i in order)]


def _building(kind: str, x: float, y: float, room_x: float, room_y: float, rng: np.random.Generator) -> Body:
    flats = kind == 'flats'
    length, width = (room_x - 5.0, room_y - 7.0) if flats else (rng.uniform(10, 13.5), rng.uniform(8, 10.5))
    turned = 0.0 if flats else float(rng.integers(4)) * math.pi / 2 + float(rng.normal(0, 0.05))
    wall = Material.BRICK if rng.random() < 0.3 else Material.PLASTER
    tint = (0.52, 0.60, 0.86) if wall == Material.BRICK else _choice(rng, _WALLS)
    if flats:
        height = 3.0 * float(rng.integers(3, 5))
        grey = float(rng.uniform(0.62, 0.95))
        return Body(solids.flat_building(length, width, height, tint, (grey, grey, grey), wall), x, y, 0.0,
                    (length, width, height))
    eaves = 3.0 * float(rng.integers(1, 3))
    ridge = eaves + float(rng.uniform(1.8, 3.0))
    shape = solids.gabled_house(length, width, eaves, ridge, tint, _choice(rng, _ROOFS), wall)
    return Body(shape, x + rng.uniform(-2, 2), y + rng.uniform(-2, 2), turned, (length, width, ridge))


def _trees(plan: Plan, count: int, buildings: list[Body], rng: np.random.Generator) -> list[Body]:
    spots = layout.tree_spots(plan, rng)
    trees: list[Body] = []
    for index in rng.permutation(len(spots)):
        x, y = spots[index]
        reach = float(rng.uniform(1.6, 2.9))
        if len(trees) >= count:
            break
        if all(math.hypot(x - b.x, y - b.y) > reach + 0.5 * math.hypot(*b.size[:2]) for b in buildings):
            height = reach * float(rng.uniform(2.2, 2.9))
            shape = solids.tree(height, reach, _choice(rng, _LEAVES), int(rng.integers(100)))
            trees.append(Body(shape, x, y, float(rng.uniform(0, 2 * math.pi)), (2 * reach, 2 * reach, height)))
    return trees


def _vehicle(x: float, y: float, heading: float, speed: float, rng: np.random.Generator, vans: float) -> Body:
    if rng.random() < vans:
        size = (float(rng.uniform(5.0, 6.2)), 2.0, float(rng.uniform(2.2, 2.7)))
        return Body(solids.van(*size, _choice(rng, _VAN_PAINTS)), x, y, heading, size, speed)
    size = (float(rng.uniform(3.9, 4.8)), float(rng.uniform(1.7, 1.85)), float(rng.uniform(1.4, 1.6)))
    return Body(solids.car(*size, _choice(rng, _PAINTS)), x, y, heading, size, speed)


def _parked(plan: Plan, count: int, rng: np.random.Generator) -> list[Body]:
    spots = layout.parking_spots(plan)
    order = rng.permutation(len(spots))[:count]
    return [_vehicle(x, y, heading, 0.0, rng, 0.0) for x, y, heading in (spots[i] for i in order)]


def _cars(plan: Plan, count: int, traffic: _Traffic, rng: np.random.Generator) -> list[Body]:
    """Driving cars; all cars of a lane share its speed, so that none runs into the one ahead."""
    lanes = layout.lanes(plan)
    speeds = rng.uniform(*_CAR_SPEED_M_S, len(lanes))
    cars: list[Body] = []
    for _ in range(count * _TRIES):
        if len(cars) >= count:
            break
        lane = int(rng.integers(len(lanes)))
        vertical, across, way = lanes[lane]
        run = float(rng.uniform(0, PERIOD_M))
        x, y = (across, run) if vertical else (run, across)
        heading = (math.pi / 2 * way) if vertical else (0.0 if way > 0 else math.pi)
        body = _vehicle(x, y, heading, float(speeds[lane]), rng, _VAN_SHARE)
        if traffic.admit(body, _CAR_GAP_M):
            cars.append(body)
    return cars


def _people(plan: Plan, count: int, traffic: _Traffic, rng: np.random.Generator) -> list[Body]:
    walks = layout.sidewalks(plan)
    people: list[Body] = []
    for _ in range(count * _TRIES):
        if len(people) >= count:
            break
        vertical, across = walks[int(rng.integers(len(walks)))]
        across += float(rng.uniform(-0.9, 0.9))
        run = float(rng.uniform(0, PERIOD_M))
        x, y = (across, run) if vertical else (run, across)
        ways = (math.pi / 2, -math.pi / 2) if vertical else (0.0, math.pi)
        body = _person(plan, x, y, ways[int(rng.integers(2))], rng)
        if body is not None and traffic.admit(body, _PERSON_GAP_M if body.speed else 1.0):
            people.append(body)
    return people


def _person(plan: Plan, x: float, y: float, heading: float, rng: np.random.Generator) -> Body | None:
    """A walker, or someone who stands; None where one would stand in the street."""
    standing = rng.random() < _STANDING_SHARE
    speed = 0.0 if standing else float(rng.uniform(*_WALK_SPEED_M_S))
    if standing and min(float(d) for d in layout.street_distance(plan, np.array(x), np.array(y))) < layout.ROAD_HALF_M:
        return None
    height = float(rng.uniform(1.6, 1.9))
    shape = solids.person(height, _choice(rng, _CLOTHES), _choice(rng, _CLOTHES), _SKIN)
    return Body(shape, x, y, heading, (solids.SHOULDER_DEPTH_M, solids.SHOULDER_WIDTH_M, height), speed)
