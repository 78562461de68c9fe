"""The plan of the town: a square of streets and blocks that repeats for ever, and what stands where."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from motion_detect_ros.core.types import DoubleArray

#: Side of the square that repeats, metres.
PERIOD_M = 256.0

ROAD_HALF_M = 5.8
WALK_END_M = 8.4
LANE_M = 1.75
PARKING_M = 4.65
_ROADS = 3
_ROAD_JITTER_M = 5.0
_LOTS = 3
_CROSSING_CLEAR_M = 14.0
_PARKING_STEP_M = 6.2
_GROVE_STEP_M = 6.0
#: Width of a parking place, distance of the rows, and of the first one from the block's edge, metres.
BAY_M, _BAY_ROW_M, _BAY_MARGIN_M = 2.7, 11.5, 5.0

BLOCK_KINDS = ('houses', 'houses', 'houses', 'flats', 'flats', 'park', 'houses', 'park', 'parking')


@dataclass(frozen=True)
class Block:
    """A rectangle between streets: ``x0 .. x1`` by ``y0 .. y1``, metres, sidewalks excluded."""

    kind: str
    x0: float
    y0: float
    x1: float
    y1: float


@dataclass(frozen=True)
class Plan:
    """Streets along y at ``across_x`` and along x at ``across_y`` (centre lines, metres), and the blocks between."""

    across_x: DoubleArray
    across_y: DoubleArray
    blocks: tuple[Block, ...]


def make_plan(seed: int) -> Plan:
    """Three streets each way, a little irregular."""
    rng = np.random.default_rng([seed, 4])
    step = PERIOD_M / _ROADS

    def streets() -> DoubleArray:
        """(3,) centre lines, metres."""
        return np.asarray(step * (np.arange(_ROADS) + 0.35) + rng.uniform(-_ROAD_JITTER_M, _ROAD_JITTER_M, _ROADS))

    xs, ys = streets(), streets()
    kinds = rng.permutation(np.array(BLOCK_KINDS))
    blocks = []
    for index, kind in enumerate(kinds):
        (x0, x1), (y0, y1) = _between(xs, index // _ROADS), _between(ys, index % _ROADS)
        blocks.append(Block(str(kind), x0, y0, x1, y1))
    return Plan(xs, ys, tuple(blocks))


def lots(block: Block) -> list[tuple[float, float, float, float]]:
    """Building plots of a block: (centre x, centre y, size x, size y), metres."""
    width, depth = (block.x1 - block.x0) / _LOTS, (block.y1 - block.y0) / _LOTS
    return [(block.x0 + (i + 0.5) * width, block.y0 + (j + 0.5) * depth, width, depth)
            for i in range(_LOTS) for j in range(_LOTS)]


def street_distance(plan: Plan, x: DoubleArray, y: DoubleArray) -> tuple[DoubleArray, DoubleArray]:
    """Distance to the centre line of the nearest street along y (from ``x``) and along x (from ``y``), metres."""
    return _nearest(x, plan.across_x), _nearest(y, plan.across_y)


def parking_spots(plan: Plan) -> list[tuple[float, float, float]]:
    """(x, y, heading) of every kerb-side place and every place in a parking block, metres and radians."""
    along = np.arange(0.0, PERIOD_M, _PARKING_STEP_M)
    spots = []
    for vertical, centres, crossings in ((True, plan.across_x, plan.across_y), (False, plan.across_y, plan.across_x)):
        free = along[_nearest(along, crossings) > _CROSSING_CLEAR_M]
        for centre in centres:
            for side in (-1, 1):
                spots += [_street_spot(vertical, float(centre), side, float(run)) for run in free]
    return spots + _lot_spots(plan)


def parking_rows(block: Block) -> tuple[DoubleArray, DoubleArray]:
    """Centres of the places of a parking block: x of the columns, y of the rows, metres."""
    return (np.arange(block.x0 + _BAY_MARGIN_M, block.x1 - _BAY_MARGIN_M, BAY_M),
            np.arange(block.y0 + _BAY_MARGIN_M, block.y1 - _BAY_MARGIN_M, _BAY_ROW_M))


def lanes(plan: Plan) -> list[tuple[bool, float, int]]:
    """(runs along y, position across, driving direction +1 / -1) of every lane; traffic keeps right."""
    return ([(True, float(x) + LANE_M * way, way) for x in plan.across_x for way in (-1, 1)]
            + [(False, float(y) - LANE_M * way, way) for y in plan.across_y for way in (-1, 1)])


def sidewalks(plan: Plan) -> list[tuple[bool, float]]:
    """(runs along y, centre line's position across) of every sidewalk."""
    middle = (ROAD_HALF_M + WALK_END_M) / 2
    return ([(True, float(x) + side * middle) for x in plan.across_x for side in (-1, 1)]
            + [(False, float(y) + side * middle) for y in plan.across_y for side in (-1, 1)])


def tree_spots(plan: Plan, rng: np.random.Generator) -> list[tuple[float, float]]:
    """Candidate places for trees: groves in parks first, then gardens and the strip along the sidewalks."""
    spots: list[tuple[float, float]] = []
    for block in plan.blocks:
        step = _GROVE_STEP_M if block.kind == 'park' else 2 * _GROVE_STEP_M
        if block.kind == 'parking':
            continue
        for x in np.arange(block.x0 + 1.6, block.x1 - 1.6, step):
            for y in np.arange(block.y0 + 1.6, block.y1 - 1.6, step):
                spots.append((float(x + rng.uniform(0, 3)), float(y + rng.uniform(0, 3))))
    return spots


def _between(centres: DoubleArray, index: int) -> tuple[float, float]:
    """From the sidewalk of one street to that of the next (the last one's next is the first of the next square)."""
    following = centres[index + 1] if index + 1 < len(centres) else centres[0] + PERIOD_M
    return float(centres[index]) + WALK_END_M, float(following) - WALK_END_M


def _nearest(position: DoubleArray, centres: DoubleArray) -> DoubleArray:
    offset = np.asarray(position)[..., None] - centres
    return np.asarray(np.abs(offset - PERIOD_M * np.rint(offset / PERIOD_M)).min(axis=-1))


def _street_spot(vertical: bool, centre: float, side: int, run: float) -> tuple[float, float, float]:
    across = centre + side * PARKING_M
    heading = np.pi / 2 * side if vertical else (np.pi if side > 0 else 0.0)
    return (across, run, float(heading)) if vertical else (run, across, float(heading))


def _lot_spots(plan: Plan) -> list[tuple[float, float, float]]:
    spots = []
    for block in plan.blocks:
        if block.kind == 'parking':
            columns, rows = parking_rows(block)
            spots += [(float(x), float(y), math.pi / 2) for x in columns for y in rows]
    return spots
