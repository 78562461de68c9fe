"""The map of the ground: asphalt with markings, sidewalks, grass, yards and the shadows of what stands on it."""

from __future__ import annotations

import math

import cv2
import numpy as np

from motion_detect_ros.core.types import ByteArray, DoubleArray, FloatArray
from motion_detect_ros.sources.synthetic import layout
from motion_detect_ros.sources.synthetic.config import FlightConfig
from motion_detect_ros.sources.synthetic.layout import PERIOD_M, ROAD_HALF_M, WALK_END_M, Block, Plan
from motion_detect_ros.sources.synthetic.textures import periodic_noise
from motion_detect_ros.sources.synthetic.town import Body, Town

MAP_PX = 2048
_PX_PER_M = MAP_PX / PERIOD_M
#: Metres of ground per repetition of the fine-detail texture.
DETAIL_M = 32.0
#: Direction to the sun: azimuth counter-clockwise from east, elevation.
SUN_AZIMUTH, SUN_ELEVATION = math.radians(128.0), math.radians(52.0)
SHADOW_DEPTH = 0.48
#: Displacement of a shadow on the ground per metre of height.
SHADOW_STEP = -np.array([math.cos(SUN_AZIMUTH), math.sin(SUN_AZIMUTH)]) / math.tan(SUN_ELEVATION)

_GRASS, _DRY = np.array([62.0, 118.0, 104.0]), np.array([96.0, 142.0, 150.0])
_ASPHALT, _PAVING = np.array([112.0, 112.0, 112.0]), np.array([158.0, 166.0, 172.0])
_YARD = np.array([138.0, 148.0, 156.0])
_PATH_HALF_M = 1.2
_PAINT = np.array([226.0, 230.0, 230.0])
_PLAIN = np.array([110.0, 122.0, 120.0])
#: Radius of a leaf layer's ragged outline, share of the layer's half side.
_OUTLINE_SHARE = 0.8
#: Strength (0..255) of the fine detail on each kind of ground.
_GRASS_DETAIL, _HARD_DETAIL = 120.0, 62.0


def paint_ground(config: FlightConfig, town: Town) -> ByteArray:
    """The map of 256 m x 256 m: (2048, 2048, 4) uint8, row r, column c at y = (r + 0.5) / 8 m, x = (c + 0.5) / 8 m.

    The fourth channel is the strength of the fine detail. ``config.ground_contrast`` pulls it all to one grey.
    """
    rng = np.random.default_rng([config.seed, 6])
    broad, fine = periodic_noise(rng, MAP_PX, 1.7), periodic_noise(rng, MAP_PX, 0.9, 24.0)
    canvas = _meadow(broad, fine)
    if config.ground == 'town':
        _lay_blocks(canvas, town, broad)
        _lay_streets(canvas, town.plan, broad, fine)
    canvas[..., :3] *= (1 - SHADOW_DEPTH * _shadows(town.bodies))[..., None]
    neutral = np.append(_PLAIN, 0.0).astype(np.float32)
    canvas = neutral + np.float32(config.ground_contrast) * (canvas - neutral)
    return np.asarray(np.clip(np.rint(canvas), 0, 255), dtype=np.uint8)


def _meadow(broad: FloatArray, fine: FloatArray) -> FloatArray:
    """(n, n, 4) float32: grass that is dry in places."""
    dry = np.clip(0.45 + 0.35 * broad, 0, 1)[..., None]
    colour = (_GRASS + (_DRY - _GRASS) * dry) * (1 + 0.10 * fine[..., None])
    return np.concatenate([colour, np.full((*fine.shape, 1), _GRASS_DETAIL)], axis=2).astype(np.float32)


def _lay(canvas: FloatArray, cover: DoubleArray, colour: DoubleArray, shade: FloatArray, detail: float) -> None:
    """Paint ``colour`` times ``shade`` where ``cover`` (0..1) says, in place, touching only the part concerned."""
    rows, columns = np.flatnonzero(cover.any(axis=1)), np.flatnonzero(cover.any(axis=0))
    if not len(rows):
        return
    part = (slice(rows[0], rows[-1] + 1), slice(columns[0], columns[-1] + 1))
    painted = np.empty_like(canvas[part])
    painted[..., :3] = colour.astype(np.float32) * shade[part][..., None].astype(np.float32)
    painted[..., 3] = detail
    canvas[part] += cover[part][..., None].astype(np.float32) * (painted - canvas[part])


def _axis() -> DoubleArray:
    return np.asarray((np.arange(MAP_PX, dtype=np.float64) + 0.5) / _PX_PER_M)


def _inside(distance: DoubleArray, limit: float) -> DoubleArray:
    """Share of a map pixel that lies within ``limit`` metres, from the distance of its centre."""
    return np.asarray(np.clip((limit - distance) * _PX_PER_M + 0.5, 0, 1))


def _lay_streets(canvas: FloatArray, plan: Plan, broad: FloatArray, fine: FloatArray) -> None:
    """Sidewalks, carriageway, markings and crossings."""
    dx, dy = layout.street_distance(plan, _axis(), _axis())
    for half_m, colour, shade in ((WALK_END_M, _PAVING, 1 + 0.05 * fine - 0.09 * _joints()),
                                  (ROAD_HALF_M, _ASPHALT, 1 + 0.07 * broad + 0.06 * fine)):
        cover = np.maximum(_inside(dx, half_m)[None], _inside(dy, half_m)[:, None])
        _lay(canvas, cover, colour, shade, _HARD_DETAIL)
    paint = np.maximum(_markings(dx[None], dy[:, None], _axis()[:, None], _axis()[None]),
                       _markings(dy[:, None], dx[None], _axis()[None], _axis()[:, None]))
    _lay(canvas, 0.85 * paint, _PAINT, 1 + 0.10 * fine, _HARD_DETAIL)


def _joints() -> FloatArray:
    """Joints of a paving of 1 m flags, 0..1."""
    line = (np.arange(MAP_PX) % int(_PX_PER_M) == 0).astype(np.float32)
    return np.asarray(np.maximum(line[:, None], line[None]))


def _markings(off: DoubleArray, crossing: DoubleArray, along: DoubleArray, across: DoubleArray) -> DoubleArray:
    """Coverage (n, n) of the paint of the streets of one direction.

    off: distance to the street's centre line; crossing: to that of the nearest crossing street; along, across:
    map coordinates along and across the street, metres.
    """
    open_road = 1 - _inside(crossing, WALK_END_M + 1.5)
    dashes = _inside(np.abs(along % 8.0 - 4.0), 2.0)
    kerb_line = _inside(np.abs(off - 2 * layout.LANE_M), 0.09)
    stop = _inside(np.abs(crossing - WALK_END_M - 1.2), 0.25) * _inside(off, 2 * layout.LANE_M)
    stripes = _inside(np.abs(across % 1.1 - 0.55), 0.28) * _inside(off, ROAD_HALF_M - 0.3)
    zebra = stripes * _inside(np.abs(crossing - (ROAD_HALF_M + WALK_END_M) / 2), 1.2)
    lines = open_road * np.maximum(dashes * _inside(off, 0.09), kerb_line)
    return np.asarray(np.maximum(np.maximum(lines, stop), zebra))


def _lay_blocks(canvas: FloatArray, town: Town, broad: FloatArray) -> None:
    """Yards around blocks of flats, asphalt in parking blocks, paths through parks."""
    for block in town.plan.blocks:
        cover = _rectangle(block.x0, block.y0, block.x1, block.y1)
        if block.kind == 'flats':
            _lay(canvas, cover, _YARD, 1 + 0.08 * broad - 0.05 * _joints(), _HARD_DETAIL)
        elif block.kind == 'parking':
            _lay(canvas, cover, _ASPHALT * 0.9, 1 + 0.09 * broad, _HARD_DETAIL)
            _lay(canvas, 0.8 * cover * _bay_lines(block), _PAINT, np.ones_like(broad), _HARD_DETAIL)
        elif block.kind == 'park':
            x, y = (block.x0 + block.x1) / 2, (block.y0 + block.y1) / 2
            paths = np.maximum(_rectangle(x - _PATH_HALF_M, block.y0, x + _PATH_HALF_M, block.y1),
                               _rectangle(block.x0, y - _PATH_HALF_M, block.x1, y + _PATH_HALF_M))
            _lay(canvas, paths, _YARD * [0.8, 0.92, 1.0], 1 + 0.08 * broad, _GRASS_DETAIL)


def _bay_lines(block: Block) -> DoubleArray:
    """Coverage of the lines between the places of a parking block."""
    columns, rows = layout.parking_rows(block)
    across = np.max([_near(x + layout.BAY_M / 2, 0.07) for x in columns], axis=0)
    return np.asarray(np.max([_near(y, 2.5) for y in rows], axis=0)[:, None] * across[None])


def _near(centre: float, half_m: float) -> DoubleArray:
    """Coverage along one axis of the strip of ``half_m`` either side of ``centre``, in whichever copy of the square."""
    offset = _axis() - centre
    return _inside(np.abs(offset - PERIOD_M * np.rint(offset / PERIOD_M)), half_m)


def _rectangle(x0: float, y0: float, x1: float, y1: float) -> DoubleArray:
    """Coverage of an axis-parallel rectangle that may reach over the edge of the square."""
    rows, columns = _near((y0 + y1) / 2, (y1 - y0) / 2), _near((x0 + x1) / 2, (x1 - x0) / 2)
    return np.asarray(rows[:, None] * columns[None])


def _shadows(bodies: tuple[Body, ...]) -> FloatArray:
    """(n, n) float32, 1 in full shadow of the scenery, soft at the edges."""
    mask = np.zeros((MAP_PX, MAP_PX), np.uint8)
    for body in bodies:
        if body.ident == 0:
            _cast(mask, body)
    wrapped = cv2.GaussianBlur(np.pad(mask, 8, mode='wrap'), (0, 0), 1.5)[8:-8, 8:-8]
    return np.asarray(wrapped.astype(np.float32) / 255)


def _cast(mask: ByteArray, body: Body) -> None:
    """Fill the hull of the shadows of all corners, in every copy that touches the square."""
    points3 = _silhouette_points(body)
    cos, sin = math.cos(body.heading), math.sin(body.heading)
    flat = points3[:, :2] @ np.array([[cos, sin], [-sin, cos]]) + [body.x, body.y] + points3[:, 2:] * SHADOW_STEP
    hull = cv2.convexHull(flat.astype(np.float32))[:, 0]
    for shift_x in (-PERIOD_M, 0.0, PERIOD_M):
        for shift_y in (-PERIOD_M, 0.0, PERIOD_M):
            points = np.rint((hull + np.array([shift_x, shift_y])) * _PX_PER_M * 16 - 8).astype(np.int32)
            cv2.fillConvexPoly(mask, points, 255, cv2.LINE_AA, 4)


def _silhouette_points(body: Body) -> DoubleArray:
    """(n, 3) points whose hull casts the shadow: corners, and for leaf layers an octagon inside the ragged outline."""
    patches = body.patches
    leaves = patches.outline >= 0
    solid = patches.corners()[~leaves].reshape(-1, 3)
    middle = patches.origin[leaves] + 0.5 * (patches.u[leaves] + patches.v[leaves])
    turns = np.arange(8) * (math.pi / 4)
    rim = [middle + 0.5 * _OUTLINE_SHARE * (math.cos(a) * patches.u[leaves] + math.sin(a) * patches.v[leaves])
           for a in turns]
    return np.concatenate([solid, *rim])
