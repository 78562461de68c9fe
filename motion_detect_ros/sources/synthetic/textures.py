"""Seamless procedural textures and the atlas they are sampled from."""

from __future__ import annotations

from dataclasses import dataclass
from enum import IntEnum

import cv2
import numpy as np

from motion_detect_ros.core.types import ByteArray, DoubleArray, FloatArray

_CELL_PX = 128
_DETAIL_PX = 512
#: Grey level of a material of reflectance 1 before tint and light.
_WHITE = 215.0
_MAX_LEVELS = 12


class Material(IntEnum):
    """What a surface is made of; the index of its texture in the atlas."""

    GROUND = 0
    DETAIL = 1
    PLASTER = 2
    BRICK = 3
    TILES = 4
    GRAVEL = 5
    PAINT = 6
    GLASS = 7
    CAR_SIDE = 8
    CLOTH = 9
    FOLIAGE = 10
    CRATE = 11


@dataclass(frozen=True)
class Atlas:
    """All textures with their mipmaps in one array.

    ``texels``: (n,) uint32, from the lowest byte up blue, green, red, fine-detail strength;
    ``offset, size``: (materials, levels) int64, first texel and side length (a power of two) of each
    level; the last level is 1 x 1.
    """

    texels: np.ndarray[tuple[int, ...], np.dtype[np.uint32]]
    offset: np.ndarray[tuple[int, ...], np.dtype[np.int64]]
    size: np.ndarray[tuple[int, ...], np.dtype[np.int64]]


def periodic_noise(rng: np.random.Generator, size: int, slope: float, low_cut: float = 1.0) -> FloatArray:
    """(size, size) float32 seamless noise of mean 0 and variance 1 whose amplitude falls as frequency ** -slope.

    low_cut: frequencies below this, cycles per tile, are left out. Source: spectral synthesis, Saupe 1988.
    """
    spectrum = np.fft.rfft2(rng.standard_normal((size, size), dtype=np.float32))
    rows = np.fft.fftfreq(size, 1 / size)[:, None]
    radius = np.hypot(rows, np.arange(size // 2 + 1)[None])
    gain = np.where(radius >= low_cut, np.maximum(radius, 1.0) ** -slope, 0.0)
    noise = np.fft.irfft2(spectrum * gain, s=(size, size))
    return np.asarray(noise / noise.std(), dtype=np.float32)


def materials(seed: int) -> list[ByteArray]:
    """Textures of all materials but the ground, in the order of ``Material``: (s, s, 4) uint8, row 0 at the foot."""
    rng = np.random.default_rng([seed, 2])
    grain = periodic_noise(rng, _CELL_PX, 0.7)
    return [
        _bgra(128 + 46 * np.clip(_detail(rng), -2.7, 2.7)), _bgra(_facade(grain)), _bgra(_brick(rng, grain)),
        _bgra(_tiles(grain)), _bgra(_gravel(rng)), _bgra(_WHITE * (1 + 0.05 * grain)),
        _bgra(_glass(grain)), _bgra(_car_side(grain)), _bgra(_WHITE * (0.9 + 0.16 * grain)),
        _bgra(_WHITE * np.clip(0.72 + 0.3 * periodic_noise(rng, _CELL_PX, 0.9, 3.0), 0.1, 1.2)),
        _bgra(_WHITE * np.clip(0.6 + 0.3 * periodic_noise(rng, _CELL_PX, 1.0, 2.0), 0.05, 1.2)),
    ]


def build_atlas(textures: list[ByteArray]) -> Atlas:
    """Mipmaps (2 x 2 means, down to one texel) of square textures (s, s, 4) uint8 with s a power of two."""
    count = len(textures)
    offset, size = np.zeros((count, _MAX_LEVELS + 1), np.int64), np.ones((count, _MAX_LEVELS + 1), np.int64)
    parts, used = [], 0
    for index, texture in enumerate(textures):
        level = texture
        for depth in range(_MAX_LEVELS + 1):
            offset[index, depth], size[index, depth] = used, level.shape[0]
            parts.append(level.reshape(-1, 4))
            used += level.shape[0] ** 2
            level = _halve(level)
    bytes_ = np.ascontiguousarray(np.concatenate(parts))
    return Atlas(bytes_.view('<u4')[:, 0].astype(np.uint32), offset, size)


def canopy_masks(seed: int, count: int = 6, size: int = 64) -> np.ndarray[tuple[int, ...], np.dtype[np.bool_]]:
    """(count, size, size) bool: ragged discs, the outlines of a tree's leaf layers."""
    rng = np.random.default_rng([seed, 3])
    axis = (np.arange(size) + 0.5) / size * 2 - 1
    radius = np.hypot(axis[:, None], axis[None])
    ragged = [radius + 0.13 * periodic_noise(rng, size, 1.2, 2.0) < 0.82 for _ in range(count)]
    return np.stack(ragged)


def _halve(level: ByteArray) -> ByteArray:
    if level.shape[0] == 1:
        return level
    side = level.shape[0] // 2
    total = level.reshape(side, 2, side, 2, 4).astype(np.uint16).sum(axis=(1, 3), dtype=np.uint16)
    return np.asarray((total + 2) // 4, dtype=np.uint8)


def _bgra(values: FloatArray | DoubleArray) -> ByteArray:
    """Grey (s, s) or colour (s, s, 3) values as (s, s, 4) uint8."""
    colour = np.repeat(values[..., None], 3, axis=2) if values.ndim == 2 else values
    alpha = np.zeros((*colour.shape[:2], 1))
    return np.asarray(np.clip(np.rint(np.concatenate([colour, alpha], axis=2)), 0, 255), dtype=np.uint8)


def _detail(rng: np.random.Generator) -> FloatArray:
    """Blades, grit and stones: what the ground shows below the resolution of its map."""
    return 0.75 * periodic_noise(rng, _DETAIL_PX, 0.6, 8.0) + 0.6 * periodic_noise(rng, _DETAIL_PX, 1.2, 4.0)


def _facade(grain: FloatArray) -> FloatArray:
    """Plaster with one window per cell."""
    wall = _WHITE * (0.95 + 0.05 * grain)
    cv2.rectangle(wall, (36, 40), (92, 104), 235.0, -1)
    cv2.rectangle(wall, (41, 45), (87, 99), 62.0, -1)
    cv2.line(wall, (64, 45), (64, 99), 225.0, 3)
    wall[60:99, 44:60] += 30
    return wall


def _brick(rng: np.random.Generator, grain: FloatArray) -> FloatArray:
    """Brick courses, each stone its own shade, with a window."""
    rows, columns = 16, 8
    shade = np.repeat(np.repeat(rng.uniform(0.7, 1.0, (rows, columns)), 8, axis=0), 16, axis=1)
    shade = np.stack([np.roll(row, 8 * (i // 8 % 2)) for i, row in enumerate(shade)])
    wall = (_WHITE * (shade + 0.04 * grain)).astype(np.float32)
    wall[::8] *= 0.8
    cv2.rectangle(wall, (38, 38), (90, 106), 240.0, -1)
    cv2.rectangle(wall, (43, 43), (85, 101), 55.0, -1)
    return wall


def _tiles(grain: FloatArray) -> FloatArray:
    """Rows of roof tiles, darker at each row's lower edge, weathered."""
    rows = (np.arange(_CELL_PX) % 16) / 16
    columns = 0.5 + 0.5 * np.cos(2 * np.pi * np.arange(_CELL_PX) / 16)
    relief = 0.70 + 0.22 * rows[:, None] + 0.08 * columns[None]
    return np.asarray(_WHITE * np.clip(relief + 0.09 * grain, 0, 1.2), dtype=np.float32)


def _gravel(rng: np.random.Generator) -> FloatArray:
    """A flat roof: gravel, stains and a few skylights."""
    size = 256
    stains = 0.07 * periodic_noise(rng, size, 0.3) + 0.07 * periodic_noise(rng, size, 1.6)
    roof = np.asarray(_WHITE * (0.78 + stains), dtype=np.float32)
    roof[:5] = roof[-5:] = roof[:, :5] = roof[:, -5:] = 235.0
    for x, y, w, h in ((40, 60, 34, 22), (150, 40, 26, 26), (120, 170, 60, 18), (200, 190, 20, 30)):
        cv2.rectangle(roof, (x, y), (x + w, y + h), 120.0, -1)
        cv2.rectangle(roof, (x + 3, y + 3), (x + w - 3, y + h - 3), 225.0, -1)
    return roof


def _glass(grain: FloatArray) -> FloatArray:
    """Dark glass with a sheen that rises towards the top."""
    sheen = np.linspace(35, 95, _CELL_PX, dtype=np.float32)[:, None]
    return np.asarray(sheen * (1 + 0.12 * grain), dtype=np.float32)


def _car_side(grain: FloatArray) -> FloatArray:
    """Body side: sill, two wheels, door gaps."""
    side = _WHITE * (0.95 + 0.05 * grain)
    side[:22] *= 0.35
    side[60:66] *= 0.8
    for x in (26, 102):
        cv2.ellipse(side, (x, 18), (15, 44), 0, 0, 360, 30.0, -1)
        cv2.ellipse(side, (x, 18), (7, 20), 0, 0, 360, 120.0, -1)
    side[30:, 63:65] *= 0.6
    return side
