"""A second hypothesis for what moves too fast: block matching where the found flow leaves the pictures unexplained.

Coarse-to-fine methods read an object that moves more than about a quarter of its size as still ground: on the level
where its step is small enough it is too small to be seen. Between stabilised pictures such an object shows as change
on both sides, where it is and where it was. Blocks there are matched within a radius; a motion that blocks agree on is
taken for those cells of a cluster that it explains much better than the found flow does.
"""

from __future__ import annotations

import cv2
import numba
import numpy as np
import numpy.typing as npt

from motion_detect_ros.core.geometry.robust import MAD_TO_SIGMA
from motion_detect_ros.core.optical_flow.alternatives.block_matching import block_error, match_blocks, refine
from motion_detect_ros.core.types import BoolArray, ByteArray, FloatArray

#: Half side of the blocks matched at half resolution, refined at full, and judging a cell, pixels.
MATCH_HALF_PX, REFINE_HALF_PX, JUDGE_HALF_PX = 3, 5, 3
#: Change from which a cell is searched: units of the image noise, and grey levels it is at least.
CHANGE_SIGMA, MIN_CHANGE_GRAY = 3.0, 5.0
#: A motion must leave at most this share of the found flow's error, at half resolution and in the end.
MATCH_SHARE, EXPLAINED_SHARE = 0.8, 0.5
#: Any other match of a block has at least so many times the error of its best.
SECOND_BEST = 1.1
#: Smaller clusters of changed cells are left alone; blocks matched of one cluster and of all at most.
MIN_CELLS, CLUSTER_BLOCKS, MAX_BLOCKS = 3, 24, 120
#: Blocks that must agree on a motion, how closely, and motions tried in one cluster.
MIN_VOTES, AGREE_PX, MAX_MOTIONS = 2, 1.5, 3
#: Motions closer to the found flow are left to the flow method: what is not fast it sees.
MIN_DIFFERENCE_PX = 2.0

_AROUND = np.ones((3, 3), np.uint8)

Integers = npt.NDArray[np.int64]


def search_fast_movers(flow: FloatArray, current: ByteArray, earlier: ByteArray, radius_px: int) -> FloatArray:
    """``flow`` with those cells replaced that a motion of up to ``radius_px`` in x and y explains much better.

    flow: (rows, columns, 2) float32 displacement current -> earlier on a grid over the pictures, pixels, NaN = unknown;
    current, earlier: (h, w) uint8, stabilised. ``flow`` itself where nothing is replaced.
    """
    rows, columns = flow.shape[:2]
    limit = max(MIN_CHANGE_GRAY, CHANGE_SIGMA * _noise(current, earlier))
    here = unexplained(current, earlier, rows, columns)
    changed = here > limit
    if np.count_nonzero(changed) < MIN_CELLS:
        return flow
    left = cv2.dilate((unexplained(earlier, current, rows, columns) > limit).astype(np.uint8), _AROUND)
    known = np.nan_to_num(flow)
    clusters = _clusters(changed)
    cells = _blocks_to_match(here, clusters)
    motions, good = _matched(current, earlier, changed, left, known, cells, limit, radius_px)
    result = flow.copy()
    numbers = clusters[cells[:, 0], cells[:, 1]]
    for number in np.unique(numbers[good]):
        near = np.argwhere(cv2.dilate((clusters == number).astype(np.uint8), _AROUND))
        agreed = _agreed(motions[good & (numbers == number)])
        _take(result, known, left, near, _centres(near, flow.shape, current.shape), agreed, current, earlier)
    return result


def unexplained(picture: ByteArray, other: ByteArray, rows: int, columns: int) -> FloatArray:
    """(rows, columns) grey levels by which ``picture`` leaves the range of the 3 x 3 pixels of ``other``, cell means.

    Half a pixel of misplacement on sharp edges is no change (after Birchfield and Tomasi 1998).
    """
    over = cv2.subtract(picture, cv2.dilate(other, _AROUND))
    under = cv2.subtract(cv2.erode(other, _AROUND), picture)
    cells: FloatArray = cv2.resize(cv2.max(over, under), (columns, rows), interpolation=cv2.INTER_AREA)
    return cells


def _noise(current: ByteArray, earlier: ByteArray) -> float:
    return float(MAD_TO_SIGMA * np.median(cv2.absdiff(current[::8, ::8], earlier[::8, ::8])))


def _clusters(changed: BoolArray) -> npt.NDArray[np.int32]:
    """(rows, columns) number of the cluster of each changed cell, 0 = none; gaps of one cell are bridged."""
    count, labels, _, _ = cv2.connectedComponentsWithStats(cv2.dilate(changed.astype(np.uint8), _AROUND))
    labels[~changed] = 0
    kept = np.bincount(labels.ravel(), minlength=count) >= MIN_CELLS
    numbers: npt.NDArray[np.int32] = np.where(kept[labels], labels, 0)
    return numbers


def _blocks_to_match(change: FloatArray, clusters: npt.NDArray[np.int32]) -> Integers:
    """(n, 2) row, column of cells spread evenly over every cluster, the most changed clusters first."""
    cells = np.argwhere(clusters > 0)
    numbers = clusters[cells[:, 0], cells[:, 1]]
    strength = np.bincount(numbers, change[cells[:, 0], cells[:, 1]])
    chosen = []
    for number in np.argsort(-strength, kind='stable')[:np.count_nonzero(strength)]:
        members = cells[numbers == number]
        chosen.append(members[::-(-len(members) // CLUSTER_BLOCKS)])
    return np.concatenate(chosen or [cells])[:MAX_BLOCKS]


def _matched(
    current: ByteArray, earlier: ByteArray, changed: BoolArray, left: ByteArray, known: FloatArray, cells: Integers,
    limit: float, radius_px: int,
) -> tuple[FloatArray, BoolArray]:
    """(n, 2) displacement of the blocks about cells, pixels, and (n,) whether it is one to be taken."""
    now, before = (cv2.resize(each, None, fx=0.5, fy=0.5, interpolation=cv2.INTER_AREA) for each in (current, earlier))
    size = now.shape[::-1]
    here = cv2.resize(cv2.dilate(changed.astype(np.uint8), _AROUND), size, interpolation=cv2.INTER_NEAREST)
    there = cv2.resize(left, size, interpolation=cv2.INTER_NEAREST)
    centres = _centres(cells, known.shape, current.shape)
    worst = _worst(current, earlier, centres, known[cells[:, 0], cells[:, 1]], limit)
    motions, good = match_blocks(
        now, before, here, there, centres // 2, worst, MATCH_HALF_PX, (radius_px + 1) // 2, SECOND_BEST)
    return _refined(current, earlier, centres, motions, good), good


def _centres(cells: Integers, grid: tuple[int, ...], picture: tuple[int, ...]) -> Integers:
    """(n, 2) x, y of the pixels nearest to the centres of cells (row, column)."""
    y, x = (((cells[:, axis] + 0.5) * picture[axis] / grid[axis]).astype(np.int64) for axis in (0, 1))
    return np.stack([x, y], axis=-1)


def _agreed(motions: FloatArray) -> FloatArray:
    """(m, 2) motions that at least ``MIN_VOTES`` of (n, 2) share, most votes first."""
    found: list[FloatArray] = []
    while len(found) < MAX_MOTIONS and len(motions) >= MIN_VOTES:
        close = np.abs(motions[:, None] - motions[None]).max(axis=2) <= AGREE_PX
        votes = close[close.sum(axis=1).argmax()]
        if votes.sum() < MIN_VOTES:
            break
        found.append(np.median(motions[votes], axis=0))
        motions = motions[~votes]
    return np.array(found, np.float32).reshape(-1, 2)


@numba.njit(cache=True, nogil=True)
def _worst(current, earlier, centres, known, limit):  # type: ignore[no-untyped-def]
    """(n,) error, grey levels, up to which a match is better than the known flow; -1 where that is good enough."""
    worst = np.full(len(centres), -1.0, np.float32)
    for n in range(len(centres)):
        error = block_error(current, earlier, centres[n, 0], centres[n, 1], known[n, 0], known[n, 1], REFINE_HALF_PX)
        if limit < error < np.inf:
            worst[n] = MATCH_SHARE * error
    return worst


@numba.njit(cache=True, nogil=True)
def _refined(current, earlier, centres, motions, good):  # type: ignore[no-untyped-def]
    """(n, 2) float32 displacement at full resolution from that at half resolution; zero where it is not good."""
    refined = np.zeros((len(centres), 2), np.float32)
    for n in range(len(centres)):
        if good[n]:
            refined[n, 0], refined[n, 1] = refine(current, earlier, centres[n, 0], centres[n, 1], 2 * motions[n, 0],
                                                  2 * motions[n, 1], REFINE_HALF_PX, 2)
    return refined


@numba.njit(cache=True, nogil=True)
def _take(result, known, left, cells, centres, motions, current, earlier):  # type: ignore[no-untyped-def]
    """Give each cell the motion that explains it best, where that is much better, another motion, and the place
    it came from changed.
    """
    rows, columns = left.shape
    for n in range(len(cells)):
        r, c, x, y = cells[n, 0], cells[n, 1], centres[n, 0], centres[n, 1]
        best = EXPLAINED_SHARE * block_error(current, earlier, x, y, known[r, c, 0], known[r, c, 1], JUDGE_HALF_PX)
        for m in range(len(motions)):
            dx, dy = motions[m, 0], motions[m, 1]
            if np.hypot(dx - known[r, c, 0], dy - known[r, c, 1]) < MIN_DIFFERENCE_PX:
                continue
            from_c, from_r = int((x + dx) * columns / current.shape[1]), int((y + dy) * rows / current.shape[0])
            if not (0 <= from_r < rows and 0 <= from_c < columns) or left[from_r, from_c] == 0:
                continue
            error = block_error(current, earlier, x, y, dx, dy, JUDGE_HALF_PX)
            if error < best:
                best, result[r, c, 0], result[r, c, 1] = error, dx, dy
