"""From clustered cells to candidate objects: connected cells of one motion."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from motion_detect_ros.core.clustering.art2 import LabelArray, similarity
from motion_detect_ros.core.geometry.boxes import Box
from motion_detect_ros.core.kernels import kernel
from motion_detect_ros.core.types import BoolArray, FloatArray


@dataclass(frozen=True)
class Segment:
    """Connected cells that move as one.

    ``rows, columns``: (n,) cell indices; ``neuron``: index of the ART2 neuron that won most of them; ``box``: bounds,
    in cells.
    """

    rows: npt.NDArray[np.int64]
    columns: npt.NDArray[np.int64]
    neuron: int
    box: Box

    def pixels(self, region: Box, grid: tuple[int, int], size: tuple[int, int]) -> BoolArray:
        """(h, w) which pixels of a region of an image lie on its cells.

        grid: rows and columns of cells of the image; size: its height and width.
        """
        cells = np.zeros(grid, np.bool_)
        cells[self.rows, self.columns] = True
        return cells[np.ix_(np.arange(region.top, region.bottom) * grid[0] // size[0],
                            np.arange(region.left, region.right) * grid[1] // size[1])]


def cells_of_all(segments: Sequence[Segment]) -> tuple[npt.NDArray[np.int64], ...]:
    """Rows and columns (N,) of the cells of segment after segment, and where those of each begin and end, (n + 1,)."""
    starts = np.concatenate([[0], np.cumsum([len(each.rows) for each in segments])])
    return np.concatenate([each.rows for each in segments]), np.concatenate([each.columns for each in segments]), starts


def cluster_motions(labels: LabelArray, motion: FloatArray, clusters: int) -> FloatArray:
    """(K, 2) mean motion of each cluster's cells, noise units; zero for the background and for clusters without cells.

    labels: (gh, gw) int32, negative = not presented; motion: (gh, gw, 2).
    """
    moving = labels.ravel() > 0
    own, vectors = labels.ravel()[moving], motion.reshape(-1, 2)[moving]
    count = np.maximum(np.bincount(own, minlength=clusters), 1)
    means = np.stack([np.bincount(own, vectors[:, axis], clusters) / count for axis in (0, 1)], axis=-1)
    return means.astype(np.float32)


def connected_segments(labels: LabelArray, motions: FloatArray, join_match: float) -> list[Segment]:
    """Connected components (8 neighbours) of foreground cells whose clusters' motions match at least ``join_match``.

    labels: (gh, gw) int32, 0 = background, negative = not presented; motions: (K, 2) of ``cluster_motions``.
    """
    joined = np.zeros((len(motions), len(motions)), np.bool_)
    _fill_joined(motions, join_match, joined)
    labels, components = np.ascontiguousarray(labels), np.zeros(labels.shape, np.int32)
    count = _label_components(labels, joined, components, np.empty((labels.size, 2), np.int32))
    starts = np.concatenate([[0], np.cumsum(np.bincount(components.ravel(), minlength=count + 1)[1:])])
    rows, columns = np.empty((2, starts[-1]), np.int64)
    summaries = np.empty((count, 6), np.int64)
    _members(labels, components, starts, starts.copy(), np.empty(len(motions), np.int64), rows, columns, summaries)
    segments, start = [], 0
    for stop, neuron, *bounds in summaries.tolist():
        segments.append(Segment(rows[start:stop], columns[start:stop], neuron, Box(*bounds)))
        start = stop
    return segments


@kernel()
def _fill_joined(motions, join_match, joined):  # type: ignore[no-untyped-def]
    """``joined``: (K, K) False, then which neurons count as one motion; the background is never joined."""
    n = motions.shape[0]
    for i in range(1, n):
        for j in range(1, n):
            match = similarity(motions[i, 0], motions[i, 1], motions[j, 0], motions[j, 1])
            joined[i, j] = i == j or match >= join_match


@kernel()
def _label_components(labels, joined, component, stack):  # type: ignore[no-untyped-def]
    """``component``: (rows, columns) zeros, then numbers from 1 on, by flood fill in raster order; returns the last.

    stack: (rows * columns, 2).
    """
    rows, columns = labels.shape
    count = 0
    for r0 in range(rows):
        for c0 in range(columns):
            if labels[r0, c0] <= 0 or component[r0, c0] > 0:
                continue
            count += 1
            component[r0, c0] = count
            stack[0, 0], stack[0, 1], top = r0, c0, 1
            while top > 0:
                top -= 1
                r, c = stack[top, 0], stack[top, 1]
                for rr in range(max(0, r - 1), min(rows, r + 2)):
                    for cc in range(max(0, c - 1), min(columns, c + 2)):
                        if labels[rr, cc] > 0 and component[rr, cc] == 0 and joined[labels[r, c], labels[rr, cc]]:
                            component[rr, cc] = count
                            stack[top, 0], stack[top, 1] = rr, cc
                            top += 1
    return count


@kernel()
def _members(  # type: ignore[no-untyped-def]
    labels, component, starts, next_at, votes, row_of, column_of, summaries,
):
    """``row_of, column_of``: (n,) of the cells, component after component, each in raster order; ``summaries``: of each
    component (6,): where its cells end, the neuron most of them have (the first of equals), left, top, right, bottom.

    starts: of component n, from 1 on: starts[n - 1] .. starts[n]; next_at: a copy of it; votes: (K,), of neurons.
    """
    rows, columns = labels.shape
    for r in range(rows):
        for c in range(columns):
            number = component[r, c]
            if number > 0:
                row_of[next_at[number - 1]], column_of[next_at[number - 1]] = r, c
                next_at[number - 1] += 1
    for number in range(len(summaries)):
        left, right, most = columns, 0, 0
        start, end = starts[number], starts[number + 1]
        votes[:] = 0
        for n in range(start, end):
            votes[labels[row_of[n], column_of[n]]] += 1
            left, right = min(left, column_of[n]), max(right, column_of[n] + 1)
        for neuron in range(len(votes)):
            most = neuron if votes[neuron] > votes[most] else most
        summaries[number, 0], summaries[number, 1] = end, most
        summaries[number, 2], summaries[number, 3] = left, row_of[start]
        summaries[number, 4], summaries[number, 5] = right, row_of[end - 1] + 1
