"""Texture look-ups: bilinear within a level, linear between levels."""

from __future__ import annotations

import math
from typing import Any

import numpy as np

from motion_detect_ros.sources.synthetic.compiled import inlined
from motion_detect_ros.sources.synthetic.textures import Material

DETAIL = int(Material.DETAIL)


@inlined
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


@inlined
def _mix(shift: int, e: Any, f: Any, g: Any, h: Any, p: Any, q: Any, r: Any, s: Any) -> Any:
    """The channel at bit ``shift`` of four packed texels, weighted."""
    return (p * _channel(e, shift) + q * _channel(f, shift)) + (r * _channel(g, shift) + s * _channel(h, shift))


@inlined
def _channel(texel: Any, shift: int) -> Any:
    """Eight bits of a packed texel; signed on the way, because that converts to float in one instruction."""
    return np.float32(np.int32((texel >> np.uint32(shift)) & np.uint32(255)))


@inlined
def _level(spread: float, last: int) -> tuple[int, float]:
    """Level whose texels are just finer than ``spread`` texels of level 0, and the share of the next coarser one."""
    level = 0
    while spread >= 2.0 and level < last:
        spread *= 0.5
        level += 1
    return level, (min(1.0, max(0.0, spread - 1.0)) if level < last else 0.0)


@inlined
def fine_detail(texels: Any, offset: Any, size: Any, u: float, v: float, spread: float) -> float:
    """Fine detail of the ground, grey levels: like ``trilinear``, first channel only."""
    level, share = _level(spread, size.shape[1] - 1)
    a = _texel_grey(texels, offset[DETAIL, level], size[DETAIL, level], u, v)
    if share == 0.0:
        return a
    return a + share * (_texel_grey(texels, offset[DETAIL, level + 1], size[DETAIL, level + 1], u, v) - a)


@inlined
def _texel_grey(texels: Any, start: int, size: int, u: float, v: float) -> float:
    """First channel of ``_texel``."""
    x, y = u * size - 0.5, v * size - 0.5
    left, top = math.floor(x), math.floor(y)
    a, b = x - left, y - top
    c0, c1 = int(left) & (size - 1), (int(left) + 1) & (size - 1)
    r0, r1 = start + (int(top) & (size - 1)) * size, start + ((int(top) + 1) & (size - 1)) * size
    upper = _channel(texels[r0 + c0], 0) + a * (_channel(texels[r0 + c1], 0) - _channel(texels[r0 + c0], 0))
    lower = _channel(texels[r1 + c0], 0) + a * (_channel(texels[r1 + c1], 0) - _channel(texels[r1 + c0], 0))
    return upper + b * (lower - upper)


@inlined
def trilinear(
    texels: Any, offset: Any, size: Any, m: int, u: float, v: float, spread: float,
) -> tuple[float, float, float, float]:
    """Look-up that averages about ``spread`` texels of level 0. Source: Williams 1983, pyramidal parametrics."""
    level, share = _level(spread, size.shape[1] - 1)
    if share == 0.0:
        return _texel(texels, offset[m, level], size[m, level], u, v)
    a = _texel(texels, offset[m, level], size[m, level], u, v)
    b = _texel(texels, offset[m, level + 1], size[m, level + 1], u, v)
    return (a[0] + share * (b[0] - a[0]), a[1] + share * (b[1] - a[1]),
            a[2] + share * (b[2] - a[2]), a[3] + share * (b[3] - a[3]))
