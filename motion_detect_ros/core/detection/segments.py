"""From clustered cells to candidate objects: connected cells of one motion."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from motion_detect_ros.core.clustering.art2 import LabelArray, similarity
from motion_detect_ros.core.geometry.boxes import Box
from motion_detect_ros.core.kernels import kernel
from motion_detect_ros.core.types import FloatArray


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
    joined = _joined(motions, join_match)
    labels = np.ascontiguousarray(labels)
    components = _label_components(labels, joined)
    rows, columns, summaries = _members(labels, components, len(motions))
    segments, start = [], 0
    for stop, neuron, *bounds in summaries.tolist():
        segments.append(Segment(rows[start:stop], columns[start:stop], neuron, Box(*bounds)))
        start = stop
    return segments


@kernel()
def _joined(motions, join_match):  # type: ignore[no-untyped-def]
    """(K, K) bool: which neurons count as one motion; the background is never joined."""
    n = motions.shape[0]
    joined = np.zeros((n, n), np.bool_)
    for i in range(1, n):
        for j in range(1, n):
            match = similarity(motions[i, 0], motions[i, 1], motions[j, 0], motions[j, 1])
            joined[i, j] = i == j or match >= join_match
    return joined


@kernel()
def _label_components(labels, joined):  # type: ignore[no-untyped-def]
    """Flood fill in raster order; 0 = no component, components count from 1."""
    rows, columns = labels.shape
    component = np.zeros((rows, columns), np.int32)
    stack = np.empty((rows * columns, 2), np.int32)
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
    return component


@kernel()
def _members(labels, component, neurons):  # type: ignore[no-untyped-def]
    """(n,) rows and columns of the cells, component after component, each in raster order; and for each component
    (6,): where its cells end, the neuron most of them have (the first of equals), left, top, right, bottom.
    """
    rows, columns = labels.shape
    count = 0
    for r in range(rows):
        for c in range(columns):
            count = max(count, component[r, c])
    starts = np.zeros(count + 2, np.int64)  # of component n: starts[n] .. starts[n + 1]
    for r in range(rows):
        for c in range(columns):
            if component[r, c] > 0:
                starts[component[r, c] + 1] += 1
    for number in range(1, count + 1):
        starts[number + 1] += starts[number]
    next_at = starts.copy()
    row_of, column_of = np.empty(starts[-1], np.int64), np.empty(starts[-1], np.int64)
    for r in range(rows):
        for c in range(columns):
            number = component[r, c]
            if number > 0:
                row_of[next_at[number]], column_of[next_at[number]] = r, c
                next_at[number] += 1
    summaries = np.empty((count, 6), np.int64)
    for number in range(1, count + 1):
        votes, left, right, most = np.zeros(neurons, np.int64), columns, 0, 0
        start, end = starts[number], starts[number + 1]
        for n in range(start, end):
            votes[labels[row_of[n], column_of[n]]] += 1
            left, right = min(left, column_of[n]), max(right, column_of[n] + 1)
        for neuron in range(neurons):
            most = neuron if votes[neuron] > votes[most] else most
        summaries[number - 1, 0], summaries[number - 1, 1] = end, most
        summaries[number - 1, 2], summaries[number - 1, 3] = left, row_of[start]
        summaries[number - 1, 4], summaries[number - 1, 5] = right, row_of[end - 1] + 1
    return row_of, column_of, summaries
