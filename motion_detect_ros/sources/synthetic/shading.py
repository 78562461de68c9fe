"""What colour is seen: trilinear texture look-up, sunlight, and the shadows of what moves."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

import numba
import numpy as np

from motion_detect_ros.core.types import DoubleArray, FloatArray
from motion_detect_ros.sources.synthetic.ground import (
    DETAIL_M,
    SHADOW_DEPTH,
    SHADOW_STEP,
    SUN_AZIMUTH,
    SUN_ELEVATION,
)
from motion_detect_ros.sources.synthetic.layout import PERIOD_M
from motion_detect_ros.sources.synthetic.raster import SUPER, Ids
from motion_detect_ros.sources.synthetic.scene import GROUND, Scene, View, turn
from motion_detect_ros.sources.synthetic.textures import Atlas, Material

_AMBIENT, _SUN = 0.52, 0.60
_DETAIL = int(Material.DETAIL)
_DETAIL_REPEAT = PERIOD_M / DETAIL_M
_SKY = 228.0
#: A shadow reaches its full depth where the sun ray crosses this much of the body's footprint, share of the ray.
_PENUMBRA = 0.12


@dataclass(frozen=True)
class Paint:
    """Per patch what shading needs: ``colour``: (n, 3) float64 tint times light; and the textures."""

    colour: DoubleArray
    atlas: Atlas


def make_paint(scene: Scene, atlas: Atlas) -> Paint:
    """Light every patch: bodies keep their heading, so this holds for the whole flight."""
    normal = turn(np.cross(scene.patches.u, scene.patches.v), scene.ahead[scene.body])
    normal /= np.linalg.norm(normal, axis=1, keepdims=True)
    outward = turn(scene.patches.origin + 0.5 * (scene.patches.u + scene.patches.v), scene.ahead[scene.body])
    outward[:, 2] = np.where(np.abs(normal[:, 2]) > 0.3, 1.0, 0.0)  # what is not a wall is seen from above
    normal *= np.where((normal * outward).sum(axis=1) < 0, -1.0, 1.0)[:, None]
    sun = np.array([math.cos(SUN_AZIMUTH) * math.cos(SUN_ELEVATION),
                    math.sin(SUN_AZIMUTH) * math.cos(SUN_ELEVATION), math.sin(SUN_ELEVATION)])
    light = _AMBIENT + _SUN * np.maximum(0.0, normal @ sun)
    light[GROUND] = 1.0  # its map is painted as lit
    return Paint(scene.patches.tint * light[:, None], atlas)


def shade(scene: Scene, view: View, paint: Paint, ids: Ids) -> FloatArray:
    """(H, W, 3) float32 picture, 0..255: one look-up per pixel, four where more than one patch meets in it."""
    atlas = paint.atlas
    dark = _cast_shadows(scene, view, ids)
    return np.asarray(_shade(
        ids, view.to_patch, scene.patches.material, scene.patches.repeat, paint.colour,
        atlas.texels, atlas.offset, atlas.size, dark))


def _cast_shadows(scene: Scene, view: View, ids: Ids) -> FloatArray:
    """(H, W) float32 factor on the ground's brightness under cars and people."""
    dark = np.ones((ids.shape[0] // SUPER, ids.shape[1] // SUPER), np.float32)
    bodies = np.unique(scene.body[view.listed])
    for body in bodies[scene.ident[bodies] > 0]:
        reach, where = scene.size[body], view.position[body]
        tip = SHADOW_STEP * reach[2]
        low, high = np.minimum(0, tip) - reach[:2].max(), np.maximum(0, tip) + reach[:2].max()
        corners = [(where[0] + x, where[1] + y, 1.0) for x in (low[0], high[0]) for y in (low[1], high[1])]
        points = np.array(corners) @ view.pose.ground_to_pixel().T
        pixels = points[:, :2] / points[:, 2:]
        (x0, y0), (x1, y1) = np.floor(pixels.min(axis=0)), np.ceil(pixels.max(axis=0))
        _darken(dark, ids, view.to_patch[GROUND], where, scene.ahead[body], reach, tip, int(x0), int(y0), int(x1), int(y1))
    return dark


@numba.njit(cache=True, nogil=True, error_model='numpy')  # type: ignore[untyped-decorator, unused-ignore]
def _darken(
    dark: Any, ids: Any, g: Any, where: Any, ahead: Any, size: Any, tip: Any, x0: int, y0: int, x1: int, y1: int,
) -> None:
    """Ground points whose ray to the sun (as long as the body is high) crosses the footprint: the slab method."""
    height, width = dark.shape
    step_x = -(tip[0] * ahead[0] + tip[1] * ahead[1])
    step_y = -(tip[1] * ahead[0] - tip[0] * ahead[1])
    for row in range(max(0, y0), min(height, y1 + 1)):
        for column in range(max(0, x0), min(width, x1 + 1)):
            near = g[2, 0] * column + g[2, 1] * row + g[2, 2]
            x = (g[0, 0] * column + g[0, 1] * row + g[0, 2]) / near * PERIOD_M - where[0]
            y = (g[1, 0] * column + g[1, 1] * row + g[1, 2]) / near * PERIOD_M - where[1]
            low, high = _crossing(x * ahead[0] + y * ahead[1], step_x, 0.5 * size[0], 0.0, 1.0)
            low, high = _crossing(y * ahead[0] - x * ahead[1], step_y, 0.5 * size[1], low, high)
            if high > low:
                dark[row, column] = min(dark[row, column], 1 - SHADOW_DEPTH * min(1.0, (high - low) / _PENUMBRA))


@numba.njit(cache=True, nogil=True, error_model='numpy', forceinline=True)  # type: ignore[untyped-decorator, unused-ignore]
def _crossing(at: float, step: float, half: float, low: float, high: float) -> tuple[float, float]:
    """The part of [low, high] where |at + lambda * step| <= half."""
    if abs(step) < 1e-12:
        return (low, high) if abs(at) <= half else (1.0, 0.0)
    a, b = (-half - at) / step, (half - at) / step
    return max(low, min(a, b)), min(high, max(a, b))


@numba.njit(cache=True, nogil=True, error_model='numpy', forceinline=True)  # type: ignore[untyped-decorator, unused-ignore]
def _texel(texels: Any, start: int, size: int, u: float, v: float) -> tuple[float, float, float, float]:
    """Bilinear look-up in one level, wrapped; u, v in repetitions, texel centres at (i + 0.5) / size."""
    x, y = u * size - 0.5, v * size - 0.5
    left, top = math.floor(x), math.floor(y)
    a, b = x - left, y - top
    c0, c1 = int(left) & (size - 1), (int(left) + 1) & (size - 1)
    r0, r1 = start + (int(top) & (size - 1)) * size, start + ((int(top) + 1) & (size - 1)) * size
    p, q = np.float32((1 - a) * (1 - b)), np.float32(a * (1 - b))
    r, s = np.float32((1 - a) * b), np.float32(a * b)
    e, f, g, h = texels[r0 + c0], texels[r0 + c1], texels[r1 + c0], texels[r1 + c1]
    return (_mix(0, e, f, g, h, p, q, r, s), _mix(8, e, f, g, h, p, q, r, s),
            _mix(16, e, f, g, h, p, q, r, s), _mix(24, e, f, g, h, p, q, r, s))


@numba.njit(cache=True, nogil=True, error_model='numpy', forceinline=True)  # type: ignore[untyped-decorator, unused-ignore]
def _mix(shift: int, e: Any, f: Any, g: Any, h: Any, p: Any, q: Any, r: Any, s: Any) -> Any:
    """The channel at bit ``shift`` of four packed texels, weighted."""
    return (p * _channel(e, shift) + q * _channel(f, shift)) + (r * _channel(g, shift) + s * _channel(h, shift))


@numba.njit(cache=True, nogil=True, error_model='numpy', forceinline=True)  # type: ignore[untyped-decorator, unused-ignore]
def _channel(texel: Any, shift: int) -> Any:
    """Eight bits of a packed texel; signed on the way, because that converts to float in one instruction."""
    return np.float32(np.int32((texel >> np.uint32(shift)) & np.uint32(255)))


@numba.njit(cache=True, nogil=True, error_model='numpy', forceinline=True)  # type: ignore[untyped-decorator, unused-ignore]
def _level(spread: float, last: int) -> tuple[int, float]:
    """Level whose texels are just finer than ``spread`` texels of level 0, and the share of the next coarser one."""
    level = 0
    while spread >= 2.0 and level < last:
        spread *= 0.5
        level += 1
    return level, (min(1.0, max(0.0, spread - 1.0)) if level < last else 0.0)


@numba.njit(cache=True, nogil=True, error_model='numpy', forceinline=True)  # type: ignore[untyped-decorator, unused-ignore]
def _grain(texels: Any, offset: Any, size: Any, u: float, v: float, spread: float) -> float:
    """Fine detail of the ground, grey levels: like ``_trilinear``, first channel only."""
    level, share = _level(spread, size.shape[1] - 1)
    a = _texel_grey(texels, offset[_DETAIL, level], size[_DETAIL, level], u, v)
    if share == 0.0:
        return a  # type: ignore[no-any-return]
    return a + share * (_texel_grey(texels, offset[_DETAIL, level + 1], size[_DETAIL, level + 1], u, v) - a)  # type: ignore[no-any-return]


@numba.njit(cache=True, nogil=True, error_model='numpy', forceinline=True)  # type: ignore[untyped-decorator, unused-ignore]
def _texel_grey(texels: Any, start: int, size: int, u: float, v: float) -> float:
    """First channel of ``_texel``."""
    x, y = u * size - 0.5, v * size - 0.5
    left, top = math.floor(x), math.floor(y)
    a, b = x - left, y - top
    c0, c1 = int(left) & (size - 1), (int(left) + 1) & (size - 1)
    r0, r1 = start + (int(top) & (size - 1)) * size, start + ((int(top) + 1) & (size - 1)) * size
    upper = _channel(texels[r0 + c0], 0) + a * (_channel(texels[r0 + c1], 0) - _channel(texels[r0 + c0], 0))
    lower = _channel(texels[r1 + c0], 0) + a * (_channel(texels[r1 + c1], 0) - _channel(texels[r1 + c0], 0))
    return upper + b * (lower - upper)  # type: ignore[no-any-return]


@numba.njit(cache=True, nogil=True, error_model='numpy', forceinline=True)  # type: ignore[untyped-decorator, unused-ignore]
def _trilinear(
    texels: Any, offset: Any, size: Any, m: int, u: float, v: float, spread: float,
) -> tuple[float, float, float, float]:
    """Look-up that averages about ``spread`` texels of level 0. Source: Williams 1983, pyramidal parametrics."""
    level, rest = _level(spread, size.shape[1] - 1)
    share = np.float32(rest)
    if rest == 0.0:
        return _texel(texels, offset[m, level], size[m, level], u, v)  # type: ignore[no-any-return]
    a = _texel(texels, offset[m, level], size[m, level], u, v)
    b = _texel(texels, offset[m, level + 1], size[m, level + 1], u, v)
    return (a[0] + share * (b[0] - a[0]), a[1] + share * (b[1] - a[1]),
            a[2] + share * (b[2] - a[2]), a[3] + share * (b[3] - a[3]))


@numba.njit(cache=True, nogil=True, error_model='numpy', forceinline=True)  # type: ignore[untyped-decorator, unused-ignore]
def _look_up(
    p: int, x: float, y: float, g: Any, material: Any, repeat: Any, colour: Any, texels: Any, offset: Any, size: Any,
) -> tuple[float, float, float]:
    """Colour of patch ``p`` at pixel (x, y)."""
    if p < 0:
        return _SKY, _SKY, _SKY
    depth = 1.0 / (g[p, 2, 0] * x + g[p, 2, 1] * y + g[p, 2, 2])
    s, t = (g[p, 0, 0] * x + g[p, 0, 1] * y + g[p, 0, 2]) * depth, (g[p, 1, 0] * x + g[p, 1, 1] * y + g[p, 1, 2]) * depth
    # repetitions per pixel along the picture's rows and columns: the derivative of the quotient S / W
    ux, vx = (g[p, 0, 0] - s * g[p, 2, 0]) * depth * repeat[p, 0], (g[p, 1, 0] - t * g[p, 2, 0]) * depth * repeat[p, 1]
    uy, vy = (g[p, 0, 1] - s * g[p, 2, 1]) * depth * repeat[p, 0], (g[p, 1, 1] - t * g[p, 2, 1]) * depth * repeat[p, 1]
    spread = math.sqrt(max(ux * ux + vx * vx, uy * uy + vy * vy))
    m, u, v = material[p], s * repeat[p, 0], t * repeat[p, 1]
    b, gr, r, fine = _trilinear(texels, offset, size, m, u, v, spread * size[m, 0])
    gain = 1.0
    if p == GROUND:
        grain = _grain(texels, offset, size, u * _DETAIL_REPEAT, v * _DETAIL_REPEAT,
                       spread * _DETAIL_REPEAT * size[_DETAIL, 0])
        gain = 1 + (grain - 128.0) / 128.0 * fine / 255.0
    return b * colour[p, 0] * gain, gr * colour[p, 1] * gain, r * colour[p, 2] * gain


@numba.njit(cache=True, nogil=True, error_model='numpy')  # type: ignore[untyped-decorator, unused-ignore]
def _shade(
    ids: Any, to_patch: Any, material: Any, repeat: Any, colour: Any, texels: Any, offset: Any, size: Any, dark: Any,
) -> Any:
    height, width = dark.shape
    out = np.empty((height, width, 3), np.float32)
    for row in range(height):
        for column in range(width):
            p = ids[2 * row, 2 * column]
            q, r, s = ids[2 * row, 2 * column + 1], ids[2 * row + 1, 2 * column], ids[2 * row + 1, 2 * column + 1]
            if p == q and p == r and p == s:
                samples, weight = 1, 1.0
            else:
                samples, weight = 4, 0.25
            blue, green, red = 0.0, 0.0, 0.0
            for k in range(samples):
                one = ids[2 * row + k // 2, 2 * column + k % 2]
                shift = 0.0 if samples == 1 else 0.25
                x, y = column + shift * (2 * (k % 2) - 1), row + shift * (2 * (k // 2) - 1)
                b, g, r_ = _look_up(one, x, y, to_patch, material, repeat, colour, texels, offset, size)
                gain = weight * dark[row, column] if one == GROUND else weight
                blue, green, red = blue + gain * b, green + gain * g, red + gain * r_
            out[row, column, 0], out[row, column, 1], out[row, column, 2] = blue, green, red
    return out
