"""Which patch is seen where: an inverse-depth buffer at twice the picture's resolution."""

from __future__ import annotations

from typing import Any

import numpy as np
import numpy.typing as npt

from motion_detect_ros.core.types import FloatArray
from motion_detect_ros.sources.synthetic.compiled import inlined, kernel
from motion_detect_ros.sources.synthetic.scene import GROUND, Scene, View, corner_depths_and_pixels

Ids = npt.NDArray[np.int32]
#: Samples per pixel and axis.
SUPER = 2
NOTHING = -1


def sample_position(index: int) -> float:
    """Pixel coordinate of a sample column or row: two a pixel, a quarter pixel either side of its centre."""
    return (index + 0.5) / SUPER - 0.5


def visible_patches(
    scene: Scene, view: View, masks: npt.NDArray[np.bool_], width: int, height: int,
) -> tuple[Ids, FloatArray]:
    """Nearest patch (2 H, 2 W) int32, -1 = sky, and its inverse depth (2 H, 2 W) float32, 1/m."""
    return draw_window(scene, view, view.listed, masks, (0, 0, width, height))


def draw_window(
    scene: Scene, view: View, listed: npt.NDArray[np.int64], masks: npt.NDArray[np.bool_],
    window: tuple[int, int, int, int],
) -> tuple[Ids, FloatArray]:
    """The patches ``listed`` alone in the pixels x0, y0, width, height of ``window``, which may leave the picture."""
    x0, y0, width, height = window
    ids = np.full((SUPER * height, SUPER * width), NOTHING, np.int32)
    nearness = np.zeros(ids.shape, np.float32)
    _, pixels = corner_depths_and_pixels(scene, listed, view.to_pixel[listed])
    rows = np.stack([pixels[..., 1].min(axis=1), pixels[..., 1].max(axis=1)], axis=1)
    _fill(listed, view.to_patch, rows, scene.patches.triangle, scene.patches.outline, masks, x0, y0, ids, nearness)
    return ids, nearness


@inlined
def _span(at_zero: float, slope: float, low: float, high: float) -> tuple[float, float]:
    """The part of [low, high] where at_zero + slope * x >= 0."""
    if slope > 0:
        return max(low, -at_zero / slope), high
    if slope < 0:
        return low, min(high, -at_zero / slope)
    return (low, high) if at_zero >= 0 else (1.0, 0.0)


@kernel
def _fill(
    listed: Any, to_patch: Any, rows: Any, triangle: Any, outline: Any, masks: Any, x0: int, y0: int,
    ids: Any, nearness: Any,
) -> None:
    """Scan-convert: within a row each edge of a patch is one linear inequality in x (homogeneous, no division)."""
    sample_rows, sample_columns = ids.shape
    for k in range(len(listed)):
        p = listed[k]
        g = to_patch[p]
        first, last = 0, sample_rows - 1
        if p != GROUND:
            first = max(first, int(np.ceil((rows[k, 0] - y0 + 0.5) * SUPER - 0.5)))
            last = min(last, int(np.floor((rows[k, 1] - y0 + 0.5) * SUPER - 0.5)))
        for row in range(first, last + 1):
            y = y0 + (row + 0.5) / SUPER - 0.5
            s0, t0, w0 = g[0, 1] * y + g[0, 2], g[1, 1] * y + g[1, 2], g[2, 1] * y + g[2, 2]
            low, high = float(x0) - 0.5, x0 + sample_columns / SUPER - 0.5
            low, high = _span(w0, g[2, 0], low, high)
            if p != GROUND:
                low, high = _span(s0, g[0, 0], low, high)
                low, high = _span(t0, g[1, 0], low, high)
                if triangle[p]:
                    low, high = _span(w0 - s0 - t0, g[2, 0] - g[0, 0] - g[1, 0], low, high)
                else:
                    low, high = _span(w0 - s0, g[2, 0] - g[0, 0], low, high)
                    low, high = _span(w0 - t0, g[2, 0] - g[1, 0], low, high)
            if low > high:
                continue
            start = max(0, int(np.ceil((low - x0 + 0.5) * SUPER - 0.5)))
            stop = min(sample_columns - 1, int(np.floor((high - x0 + 0.5) * SUPER - 0.5)))
            for column in range(start, stop + 1):
                x = x0 + (column + 0.5) / SUPER - 0.5
                near = w0 + g[2, 0] * x
                if near <= nearness[row, column]:
                    continue
                if outline[p] >= 0 and not _in_outline(
                        masks[outline[p]], (s0 + g[0, 0] * x) / near, (t0 + g[1, 0] * x) / near):
                    continue
                nearness[row, column] = near
                ids[row, column] = p


@inlined
def _in_outline(mask: Any, s: float, t: float) -> bool:
    size = mask.shape[0]
    return bool(mask[min(size - 1, max(0, int(t * size))), min(size - 1, max(0, int(s * size)))])


@kernel
def owners(ids: Any, nearness: Any, body: Any) -> Any:
    """(H, W) int32 patch that owns each pixel: of the body that covers most of its samples, the nearer one in a tie."""
    height, width = ids.shape[0] // SUPER, ids.shape[1] // SUPER
    out = np.empty((height, width), np.int32)
    for y in range(height):
        for x in range(width):
            best, best_score = NOTHING, -1.0
            for a in range(SUPER * SUPER):
                row, column = y * SUPER + a // SUPER, x * SUPER + a % SUPER
                p = ids[row, column]
                if a and p == best:
                    continue
                same = 0
                for b in range(SUPER * SUPER):
                    q = ids[y * SUPER + b // SUPER, x * SUPER + b % SUPER]
                    if q == p or (q >= 0 and p >= 0 and body[q] == body[p]):
                        same += 1
                score = same + min(0.9, float(nearness[row, column]))  # nearness is under 1: nothing within a metre
                if score > best_score:
                    best, best_score = p, score
            out[y, x] = best
    return out
