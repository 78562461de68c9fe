"""ART2, the classic variant, on a frame of vectors: Carpenter and Grossberg's stages (``art2_layers``) in order.

Growth presents the most novel vector first, as the other variant does; then all vectors are presented in passes until
the assignments settle. A pass presents them in an order that depends on their values only, not on the raster.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from motion_detect_ros.core.clustering.alternatives.art2_layers import (
    NO_NEURON,
    F1Constants,
    U,
    commitment,
    layer_p,
    reset_match,
    resonate,
    search,
    settle,
)
from motion_detect_ros.core.clustering.art2_network import Art2Network, LabelArray
from motion_detect_ros.core.config import Art2Config
from motion_detect_ros.core.kernels import kernel
from motion_detect_ros.core.types import DoubleArray, FloatArray

#: Fast learning ends when every weight is within this share of where updates lead it, or after so many updates.
SETTLED_SHARE, MAX_UPDATES = 1e-3, 1000
#: Seed of the order in which a pass presents the vectors, once they are sorted.
ORDER_SEED = 0


@dataclass(frozen=True)
class Settled:
    """``vectors``: (N, D) inputs; ``u``: (N, D) F1's output; ``background_match``: 1 background, 0 not, NaN unknown.

    ``order``: rows of all that is not background, in an order that depends on the vectors' values only.
    """

    vectors: FloatArray
    u: FloatArray
    background_match: DoubleArray
    order: npt.NDArray[np.int64]


class Art2Classic(Art2Network[Settled]):
    """The classic variant: one neuron for each direction; prototypes are top-down weights, of length 1 / (1 - d)."""

    spread_match = 0.95
    clearly_moving = 1.0

    def __init__(self, config: Art2Config) -> None:
        super().__init__(config)
        self._constants = F1Constants(config.a, config.b, config.c, config.d, config.e, config.theta)

    def _feed(self, vectors: FloatArray) -> Settled:
        length = np.linalg.norm(vectors, axis=1)
        u = _settled(vectors, self._constants)
        nothing = (length <= self._config.background_sigma) | ~u.any(axis=1)
        background_match = np.where(nothing, 1.0, 0.0)
        background_match[~np.isfinite(length)] = np.nan
        return Settled(vectors, u, background_match, _fixed_order(vectors, np.flatnonzero(background_match == 0.0)))

    def _compete(self, f1: Settled, labels: LabelArray, match: FloatArray) -> int:
        return int(_compete(
            f1.u, f1.background_match, self.prototypes, self._constants, self._config.vigilance, labels, match))

    def _grow(self, f1: Settled, labels: LabelArray, match: FloatArray) -> None:
        super()._grow(f1, labels, match)
        self._compete(f1, labels, match)

    def _compete_new(self, f1: Settled, labels: LabelArray, match: FloatArray) -> None:
        _match_new(f1.u, f1.background_match, self.prototypes, self._constants, match)

    def _commitment(self, f1: Settled, index: int) -> FloatArray:
        return commitment(f1.u[index], self._constants)

    def _learn(self, f1: Settled, labels: LabelArray) -> None:
        updates = MAX_UPDATES if self._config.learning == 'fast' else 1
        _present_all(f1.vectors, f1.order, self.prototypes, self._constants, self._config.vigilance,
                     self._config.learning_rate, updates)

    def _pair_matches(self) -> DoubleArray:
        length = np.linalg.norm(self.prototypes, axis=1, keepdims=True)
        directions = np.ascontiguousarray(self.prototypes / np.maximum(length, 1e-12), np.float32)
        matches = _reset_matches(directions, self.prototypes, self._constants)
        symmetric: DoubleArray = np.minimum(matches, matches.T)
        return symmetric


def _fixed_order(vectors: FloatArray, rows: npt.NDArray[np.int64]) -> npt.NDArray[np.int64]:
    """``rows`` sorted by their vectors, then shuffled with a fixed seed."""
    in_order = rows[np.lexsort(vectors[rows].T[::-1])]
    return in_order[np.random.default_rng(ORDER_SEED).permutation(len(rows))]


@kernel()
def _settled(vectors, k):  # type: ignore[no-untyped-def]
    """(N, D) u of every vector without feedback from F2."""
    n, dimension = vectors.shape
    u, f1 = np.zeros((n, dimension), np.float32), np.zeros((6, dimension), np.float32)
    nothing = np.zeros((1, dimension), np.float32)
    for i in range(n):
        if np.all(np.isfinite(vectors[i])):
            settle(vectors[i], nothing, k, f1)
            u[i] = f1[U]
    return u


@kernel()
def _compete(u, background_match, prototypes, k, vigilance, labels, match):  # type: ignore[no-untyped-def]
    """Recall: the neuron that resonates, else the nearest; returns how many labels changed."""
    changed = 0
    f1, reset = np.zeros((6, u.shape[1]), np.float32), np.zeros(prototypes.shape[0], np.bool_)
    for i in range(u.shape[0]):
        best, best_match = (0, background_match[i]) if background_match[i] > 0.0 else (-1, 0.0)
        if background_match[i] == 0.0:
            f1[U] = u[i]
            winner, best_match, nearest = search(prototypes, k, vigilance, reset, f1)
            best = max(0, winner if winner != NO_NEURON else nearest)
        if labels[i] != best:
            changed += 1
        labels[i], match[i] = best, best_match
    return changed


@kernel()
def _match_new(u, background_match, prototypes, k, match):  # type: ignore[no-untyped-def]
    """``match`` after the newest neuron was committed."""
    new = prototypes.shape[0] - 1
    f1 = np.zeros((6, u.shape[1]), np.float32)
    for i in range(u.shape[0]):
        if background_match[i] == 0.0:
            f1[U] = u[i]
            layer_p(prototypes, new, k, f1)
            match[i] = max(match[i], reset_match(k, f1))


@kernel()
def _present_all(vectors, order, prototypes, k, vigilance, rate, updates):  # type: ignore[no-untyped-def]
    """One pass: every vector settles, searches, and trains the neuron that resonates; none is committed."""
    f1, reset = np.zeros((6, vectors.shape[1]), np.float32), np.zeros(prototypes.shape[0], np.bool_)
    tolerance = SETTLED_SHARE * rate * k.d
    for i in order:
        settle(vectors[i], prototypes, k, f1)
        winner, _, _ = search(prototypes, k, vigilance, reset, f1)
        if winner != NO_NEURON:
            resonate(vectors[i], prototypes, winner, rate, k, updates, tolerance, f1)


@kernel()
def _reset_matches(directions, prototypes, k):  # type: ignore[no-untyped-def]
    """(K, K) match of every direction with every neuron."""
    count = prototypes.shape[0]
    matches, f1 = np.zeros((count, count), np.float64), np.zeros((6, prototypes.shape[1]), np.float32)
    for i in range(count):
        f1[U] = directions[i]
        for j in range(count):
            layer_p(prototypes, j, k, f1)
            matches[i, j] = reset_match(k, f1)
    return matches
