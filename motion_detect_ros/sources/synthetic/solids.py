"""Everything that stands on the ground, made of textured parallelograms and triangles."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass, replace

import numpy as np
import numpy.typing as npt

from motion_detect_ros.core.types import BoolArray, DoubleArray
from motion_detect_ros.sources.synthetic.textures import Material

Vector = tuple[float, float, float]

#: Metres of facade per repetition of the facade texture (one window).
_WINDOW_M = 3.0
_TILE_M = 3.2
_LEAF_M = 2.4
_BARK: Vector = (0.22, 0.28, 0.34)
_CANOPY_LAYERS = 8
#: Bodies that a tree's leaf layers take their outline from, see ``textures.canopy_masks``.
_CANOPY_MASKS = 6
_CABIN_DARK = 0.9
#: Extent of a person's torso along and across the heading, metres.
SHOULDER_DEPTH_M, SHOULDER_WIDTH_M = 0.32, 0.56


@dataclass(frozen=True)
class Patches:
    """n flat pieces: point = origin + s * u + t * v with s, t in [0, 1] (s + t <= 1 for a triangle).

    ``origin, u, v``: (n, 3) float64, metres, frame of the body (x ahead, y left, z up from the ground);
    ``material``: (n,) int64; ``repeat``: (n, 2) float64, texture repetitions along u and v; ``tint``: (n, 3)
    float64, blue green red reflectance; ``triangle``: (n,) bool; ``outline``: (n,) int64, mask that cuts the
    patch, -1 = none.
    """

    origin: DoubleArray
    u: DoubleArray
    v: DoubleArray
    material: npt.NDArray[np.int64]
    repeat: DoubleArray
    tint: DoubleArray
    triangle: BoolArray
    outline: npt.NDArray[np.int64]

    def __len__(self) -> int:
        return len(self.origin)

    def corners(self) -> DoubleArray:
        """(n, 4, 3) float64 corner points; the fourth of a triangle repeats its first."""
        far = np.where(self.triangle[:, None], self.origin, self.origin + self.u + self.v)
        return np.stack([self.origin, self.origin + self.u, self.origin + self.v, far], axis=1)


def join(parts: Iterable[Patches]) -> Patches:
    """All patches of ``parts``, in order."""
    listed = list(parts)
    return Patches(*(np.concatenate([getattr(part, name) for part in listed]) for name in Patches.__dataclass_fields__))


def patch(
    origin: Vector, u: Vector, v: Vector, material: Material, tint: Vector,
    repeat: tuple[float, float] = (1.0, 1.0), triangle: bool = False, outline: int = -1,
) -> Patches:
    """One patch; see ``Patches``."""
    return Patches(
        np.array([origin], float), np.array([u], float), np.array([v], float), np.array([int(material)]),
        np.array([repeat], float), np.array([tint], float), np.array([triangle]), np.array([outline]))


def box(
    centre: tuple[float, float], size: tuple[float, float], low: float, high: float,
    side: Material, top: Material, tint: Vector, top_tint: Vector | None = None, cell_m: float = 0.0,
) -> Patches:
    """Four walls and a lid. ``cell_m``: metres per repetition of the wall's texture, 0 = stretched over each wall."""
    x, y = centre[0] - size[0] / 2, centre[1] - size[1] / 2
    length, width, height = size[0], size[1], high - low

    def cells(run: float) -> tuple[float, float]:
        """Repetitions of the texture along a wall of ``run`` metres and up it, at least one each."""
        return (max(1.0, round(run / cell_m)), max(1.0, round(height / cell_m))) if cell_m else (1.0, 1.0)

    up = (0.0, 0.0, height)
    return join([
        patch((x, y, low), (length, 0, 0), up, side, tint, cells(length)),
        patch((x + length, y, low), (0, width, 0), up, side, tint, cells(width)),
        patch((x + length, y + width, low), (-length, 0, 0), up, side, tint, cells(length)),
        patch((x, y + width, low), (0, -width, 0), up, side, tint, cells(width)),
        patch((x, y, high), (length, 0, 0), (0, width, 0), top, top_tint or tint)])


def flat_building(
    length: float, width: float, height: float, tint: Vector, roof_tint: Vector, wall: Material,
) -> Patches:
    """A block with a flat roof and a machine room on it."""
    return join([
        box((0, 0), (length, width), 0, height, wall, Material.GRAVEL, tint, roof_tint, _WINDOW_M),
        box((length * 0.2, width * 0.1), (length * 0.2, width * 0.25), height, height + 2.0,
            Material.PAINT, Material.GRAVEL, tint, roof_tint)])


def gabled_house(
    length: float, width: float, eaves: float, ridge: float, tint: Vector, roof_tint: Vector, wall: Material,
) -> Patches:
    """Walls up to ``eaves``, a gabled roof along the length up to ``ridge`` with a little overhang, a chimney."""
    walls = box((0, 0), (length, width), 0, eaves, wall, Material.GRAVEL, tint, roof_tint, _WINDOW_M)
    rise, half, over = ridge - eaves, width / 2, 0.4
    drop = over * rise / half
    tiles = (max(1.0, round(length / _TILE_M)), max(1.0, round(half / _TILE_M)))
    run, x = length + 2 * over, -length / 2 - over
    slopes = [
        patch((x, -half - over, eaves - drop), (run, 0, 0), (0, half + over, rise + drop),
              Material.TILES, roof_tint, tiles),
        patch((-x, half + over, eaves - drop), (-run, 0, 0), (0, -half - over, rise + drop),
              Material.TILES, roof_tint, tiles)]
    gables = [patch((end, -half, eaves), (0, half, rise), (0, width, 0), Material.PAINT, tint, triangle=True)
              for end in (-length / 2, length / 2)]
    chimney = box((length * 0.25, width * 0.15), (0.7, 0.7), eaves, ridge + 0.8,
                  Material.BRICK, Material.GLASS, (0.45, 0.5, 0.7))
    return join([walls, *slopes, *gables, chimney])


def tree(height: float, radius: float, tint: Vector, turn: int) -> Patches:
    """A trunk and ragged leaf layers, one over the other, narrow at the foot and the top, lighter upwards."""
    layers = []
    for index in range(_CANOPY_LAYERS):
        share = (index + 0.5) / _CANOPY_LAYERS
        reach = radius * (0.45 + 0.55 * np.sin(np.pi * min(1.0, 0.28 + 0.72 * share)) ** 0.8)
        level = height * (0.3 + 0.7 * share)
        shade = 0.45 + 0.6 * share
        colour = (tint[0] * shade, tint[1] * shade, tint[2] * shade)
        layers.append(patch(
            (-reach, -reach, level), (2 * reach, 0, 0), (0, 2 * reach, 0), Material.FOLIAGE, colour,
            (2 * reach / _LEAF_M, 2 * reach / _LEAF_M), outline=(index + turn) % _CANOPY_MASKS))
    trunk = box((0, 0), (0.4, 0.4), 0, height * 0.4, Material.CLOTH, Material.CLOTH, _BARK)
    return join([trunk, *layers])


def car(length: float, width: float, height: float, tint: Vector) -> Patches:
    """Body with wheels, bonnet and boot, and a narrower cabin with slanted glass front and back."""
    waist, sill = 0.6 * height, 0.15
    body = box((0, 0), (length, width), sill, waist, Material.CAR_SIDE, Material.PAINT, tint)
    ends = np.isin(np.arange(len(body)), (1, 3))  # front and back have no wheels
    body = replace(body, material=np.where(ends, int(Material.PAINT), body.material))
    return join([body, _cabin(length, width * 0.44, waist, height, tint)])


def van(length: float, width: float, height: float, tint: Vector) -> Patches:
    """A delivery van or bus: one high box, a dark windscreen on its front."""
    half, glass = length / 2, height * 0.55
    hull = box((0, 0), (length, width), 0.2, height, Material.CAR_SIDE, Material.PAINT, tint)
    screen = patch((half + 0.03, -width * 0.44, glass), (0, width * 0.88, 0), (0, 0, height * 0.35),
                   Material.GLASS, (1, 1, 1))
    stripe = patch((half - 0.9, -width * 0.45, height + 0.02), (0.5, 0, 0), (0, width * 0.9, 0),
                   Material.GLASS, (1, 1, 1))
    return join([hull, screen, stripe])


def person(height: float, coat: Vector, trousers: Vector, skin: Vector) -> Patches:
    """Legs, torso and head; x ahead, shoulders across."""
    hip, neck = 0.5 * height, 0.85 * height
    return join([
        box((0, 0), (0.28, 0.36), 0, hip, Material.CLOTH, Material.CLOTH, trousers),
        box((0, 0), (SHOULDER_DEPTH_M, SHOULDER_WIDTH_M), hip, neck, Material.CLOTH, Material.CLOTH, coat),
        box((0, 0), (0.24, 0.22), neck, height, Material.PAINT, Material.PAINT, skin)])


def crate(length: float, width: float, height: float, tint: Vector) -> Patches:
    """A box with a strong texture of its own."""
    return box((0, 0), (length, width), 0, height, Material.CRATE, Material.CRATE, tint)


def _cabin(length: float, half: float, low: float, high: float, tint: Vector) -> Patches:
    """Roof, slanted windscreens and trapezoid side windows (a rectangle and two triangles each)."""
    back, front, slope, rise = -0.38 * length, 0.26 * length, 0.13 * length, high - low
    dark = (_CABIN_DARK,) * 3
    roof_run = front - back - 2 * slope
    parts = [
        patch((back + slope, -half, high), (roof_run, 0, 0), (0, 2 * half, 0), Material.PAINT, tint),
        patch((front, -half, low), (0, 2 * half, 0), (-slope, 0, rise), Material.GLASS, dark),
        patch((back, half, low), (0, -2 * half, 0), (slope, 0, rise), Material.GLASS, dark)]
    for side in (-half, half):
        parts += [
            patch((back + slope, side, low), (roof_run, 0, 0), (0, 0, rise), Material.GLASS, dark),
            patch((back + slope, side, low), (-slope, 0, 0), (0, 0, rise), Material.GLASS, dark, triangle=True),
            patch((front - slope, side, low), (slope, 0, 0), (0, 0, rise), Material.GLASS, dark, triangle=True)]
    return join(parts)
