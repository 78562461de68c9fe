"""What colour is seen: trilinear texture look-up, sunlight, and the shadows of what moves."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

import numpy as np

from motion_detect_ros.core.types import DoubleArray, FloatArray
from motion_detect_ros.sources.synthetic.compiled import inlined, kernel
from motion_detect_ros.sources.synthetic.ground import (
    DETAIL_M,
    SHADOW_DEPTH,
    SHADOW_STEP,
    SUN_AZIMUTH,
    SUN_ELEVATION,
)
from motion_detect_ros.sources.synthetic.layout import PERIOD_M
from motion_detect_ros.sources.synthetic.raster import SUPER, Ids
from motion_detect_ros.sources.synthetic.sampling import DETAIL, fine_detail, trilinear
from motion_detect_ros.sources.synthetic.scene import GROUND, Scene, View, turn
from motion_detect_ros.sources.synthetic.textures import Atlas

_AMBIENT, _SUN = 0.52, 0.60
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
        window = (int(x0), int(y0), int(x1), int(y1))
        _darken(dark, view.to_patch[GROUND], where, scene.ahead[body], reach, tip, window)
    return dark


@kernel
def _darken(
    dark: Any, g: Any, where: Any, ahead: Any, size: Any, tip: Any, window: tuple[int, int, int, int],
) -> None:
    """Ground points whose ray to the sun (as long as the body is high) crosses the footprint: the slab method."""
    (height, width), (x0, y0, x1, y1) = dark.shape, window
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


@inlined
def _crossing(at: float, step: float, half: float, low: float, high: float) -> tuple[float, float]:
    """The part of [low, high] where |at + lambda * step| <= half."""
    if abs(step) < 1e-12:
        return (low, high) if abs(at) <= half else (1.0, 0.0)
    a, b = (-half - at) / step, (half - at) / step
    return max(low, min(a, b)), min(high, max(a, b))


@inlined
def _look_up(
    p: int, x: float, y: float, g: Any, material: Any, repeat: Any, colour: Any, texels: Any, offset: Any, size: Any,
) -> tuple[float, float, float]:
    """Colour of patch ``p`` at pixel (x, y)."""
    if p < 0:
        return _SKY, _SKY, _SKY
    depth = 1.0 / (g[p, 2, 0] * x + g[p, 2, 1] * y + g[p, 2, 2])
    s = (g[p, 0, 0] * x + g[p, 0, 1] * y + g[p, 0, 2]) * depth
    t = (g[p, 1, 0] * x + g[p, 1, 1] * y + g[p, 1, 2]) * depth
    # repetitions per pixel along the picture's rows and columns: the derivative of the quotient S / W
    ux, vx = (g[p, 0, 0] - s * g[p, 2, 0]) * depth * repeat[p, 0], (g[p, 1, 0] - t * g[p, 2, 0]) * depth * repeat[p, 1]
    uy, vy = (g[p, 0, 1] - s * g[p, 2, 1]) * depth * repeat[p, 0], (g[p, 1, 1] - t * g[p, 2, 1]) * depth * repeat[p, 1]
    spread = math.sqrt(max(ux * ux + vx * vx, uy * uy + vy * vy))
    m, u, v = material[p], s * repeat[p, 0], t * repeat[p, 1]
    b, gr, r, fine = trilinear(texels, offset, size, m, u, v, spread * size[m, 0])
    gain = 1.0
    if p == GROUND:
        grain = fine_detail(texels, offset, size, u * _DETAIL_REPEAT, v * _DETAIL_REPEAT,
                       spread * _DETAIL_REPEAT * size[DETAIL, 0])
        gain = 1 + (grain - 128.0) / 128.0 * fine / 255.0
    return b * colour[p, 0] * gain, gr * colour[p, 1] * gain, r * colour[p, 2] * gain


@kernel
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
