"""Block matching between two pictures: all allowed places within a radius, unique, the same both ways."""

from __future__ import annotations

import numba
import numpy as np

#: Any other good match is looked for outside this distance from the best, pixels.
APART_PX = 2
#: By how much the way back may miss, pixels.
RETURN_PX = 1


@numba.njit(cache=True, nogil=True)
def match_blocks(current, earlier, here, there, centres, worst, half, radius, second):  # type: ignore[no-untyped-def]
    """Where the blocks of ``current`` were in ``earlier``, to a pixel of these pictures.

    current, earlier: (h, w) uint8; here, there: (h, w) uint8, over 0 where a block of the current or the earlier
    picture may have its centre; centres: (n, 2) int64 x, y; worst: (n,) float32 largest error of a match, grey
    levels, negative = not to be matched; half: half side of a block; radius: largest displacement in x and y, pixels;
    second: any match apart from the best has at least so many times its error.
    Returns (n, 2) int64 displacement x, y and (n,) bool: matched, uniquely and both ways.
    """
    motions, good = np.zeros((len(centres), 2), np.int64), np.zeros(len(centres), np.bool_)
    costs = np.empty((2 * radius + 1, 2 * radius + 1), np.float32)
    for n in range(len(centres)):
        if worst[n] < 0.0:
            continue
        x, y = centres[n, 0], centres[n, 1]
        dx, dy, best = _search(current, earlier, there, x, y, half, radius, worst[n], second, costs)
        if best > worst[n] or not _unique(costs, dx + radius, dy + radius, max(best, np.float32(1.0)) * second):
            continue
        back_x, back_y, _ = _search(earlier, current, here, x + dx, y + dy, half, radius, worst[n], second, costs)
        motions[n, 0], motions[n, 1] = dx, dy
        good[n] = abs(back_x + dx) <= RETURN_PX and abs(back_y + dy) <= RETURN_PX
    return motions, good


@numba.njit(cache=True, nogil=True)
def block_error(current, earlier, x, y, dx, dy, half):  # type: ignore[no-untyped-def]
    """Mean absolute difference, grey levels, of the block of ``current`` about (x, y) and that of ``earlier`` about
    (x + dx, y + dy), linear between pixels; infinite where either leaves its picture.
    """
    height, width = current.shape
    x0, y0 = int(np.floor(x + dx)), int(np.floor(y + dy))
    a, b = x + dx - x0, y + dy - y0
    if min(x, x0, y, y0) < half or max(x, x0 + 1) >= width - half or max(y, y0 + 1) >= height - half:
        return np.inf
    total = 0.0
    for v in range(-half, half + 1):
        for u in range(-half, half + 1):
            top = (1 - a) * earlier[y0 + v, x0 + u] + a * earlier[y0 + v, x0 + u + 1]
            low = (1 - a) * earlier[y0 + v + 1, x0 + u] + a * earlier[y0 + v + 1, x0 + u + 1]
            total += abs(current[y + v, x + u] - ((1 - b) * top + b * low))
    return total / (2 * half + 1) ** 2


@numba.njit(cache=True, nogil=True)
def refine(current, earlier, x, y, dx, dy, half, reach):  # type: ignore[no-untyped-def]
    """Displacement of least error within ``reach`` whole pixels of (dx, dy), then between pixels; x, y.

    Between pixels: two lines of equal slope through the errors beside the least.
    """
    best, best_x, best_y = np.inf, dx, dy
    for v in range(dy - reach, dy + reach + 1):
        for u in range(dx - reach, dx + reach + 1):
            error = block_error(current, earlier, x, y, u, v, half)
            if error < best:
                best, best_x, best_y = error, u, v
    left, right = (block_error(current, earlier, x, y, best_x - 1, best_y, half),
                   block_error(current, earlier, x, y, best_x + 1, best_y, half))
    above, below = (block_error(current, earlier, x, y, best_x, best_y - 1, half),
                    block_error(current, earlier, x, y, best_x, best_y + 1, half))
    return best_x + _between(left, best, right), best_y + _between(above, best, below)


@numba.njit(cache=True, nogil=True)
def _between(before, least, after):  # type: ignore[no-untyped-def]
    rise = max(before, after) - least
    return 0.5 * (before - after) / rise if np.isfinite(rise) and rise > 0.0 else 0.0


@numba.njit(cache=True, nogil=True)
def _search(one, other, allowed, x, y, half, radius, worst, second, costs):  # type: ignore[no-untyped-def]
    """Displacement of least mean absolute difference, and that; fills ``costs``, infinite where they do not matter."""
    height, width = one.shape
    costs[:] = np.inf
    best_x, best_y, best = 0, 0, np.float32(np.inf)
    if x < half or y < half or x >= width - half or y >= height - half:
        return best_x, best_y, best
    count = (2 * half + 1) ** 2
    enough = second * worst * count
    for dy in range(max(-radius, half - y), min(radius, height - 1 - half - y) + 1):
        for dx in range(max(-radius, half - x), min(radius, width - 1 - half - x) + 1):
            if allowed[y + dy, x + dx] == 0:
                continue
            total = np.int32(0)
            for v in range(-half, half + 1):
                for u in range(-half, half + 1):
                    total += abs(np.int32(one[y + v, x + u]) - np.int32(other[y + dy + v, x + dx + u]))
                if total > enough:
                    break
            if total > enough:
                continue
            cost = np.float32(total / count)
            costs[dy + radius, dx + radius] = cost
            if cost < best:
                best_x, best_y, best = dx, dy, cost
                enough = min(enough, second * max(cost, np.float32(1.0)) * count)
    return best_x, best_y, best


@numba.njit(cache=True, nogil=True)
def _unique(costs, column, row, limit):  # type: ignore[no-untyped-def]
    """Nothing outside ``APART_PX`` from (column, row) is under ``limit``."""
    for r in range(costs.shape[0]):
        for c in range(costs.shape[1]):
            if costs[r, c] < limit and (abs(r - row) > APART_PX or abs(c - column) > APART_PX):
                return False
    return True
