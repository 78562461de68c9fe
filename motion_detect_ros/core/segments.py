"""From clustered cells to candidate objects: connected cells of one motion."""

from __future__ import annotations

from dataclasses import dataclass

import numba
import numpy as np
import numpy.typing as npt

from motion_detect_ros.core.art2 import LabelArray, similarity
from motion_detect_ros.core.types import FloatArray


@dataclass(frozen=True)
class Segment:
    """Connected cells that move as one.

    ``rows, columns``: (n,) cell indices; ``neuron``: index of the ART2 neuron that won most of them.
    """

    rows: npt.NDArray[np.int64]
    columns: npt.NDArray[np.int64]
    neuron: int


def connected_segments(labels: LabelArray, prototypes: FloatArray, join_match: float) -> list[Segment]:
    """Connected components (8 neighbours) of foreground cells whose neurons match at least ``join_match``.

    labels: (gh, gw) int32, 0 = background, negative = not presented; prototypes: (K, 2).
    """
    joined = _joined(prototypes, join_match)
    components = _label_components(np.ascontiguousarray(labels), joined)
    rows, columns = np.nonzero(components)
    order = np.argsort(components[rows, columns], kind='stable')
    rows, columns = rows[order], columns[order]
    bounds = np.flatnonzero(np.diff(components[rows, columns])) + 1
    pieces = zip(np.split(rows, bounds), np.split(columns, bounds), strict=True)
    return [Segment(r, c, int(np.bincount(labels[r, c]).argmax())) for r, c in pieces if len(r)]


@numba.njit(cache=True, nogil=True)
def _joined(prototypes, join_match):  # type: ignore[no-untyped-def]
    """(K, K) bool: which neurons count as one motion; the background joins nothing."""
    n = prototypes.shape[0]
    joined = np.zeros((n, n), np.bool_)
    for i in range(1, n):
        for j in range(1, n):
            match = similarity(prototypes[i, 0], prototypes[i, 1], prototypes[j, 0], prototypes[j, 1])
            joined[i, j] = i == j or match >= join_match
    return joined


@numba.njit(cache=True, nogil=True)
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
