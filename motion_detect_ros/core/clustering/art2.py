"""ART2 clustering of motion vectors: the variant that keeps magnitude, and the choice of a variant.

The stages are those of adaptive resonance theory (Carpenter and Grossberg 1987; Fausett 1994, section 5.3): an input
is presented, F2 neurons compete for it, the winner is tested against the vigilance, resonance makes the winner learn,
reset of every winner commits a new neuron. ART2's normalisation drops the magnitude, so two speeds in one direction
would be one class (``art2_classic``); here match and vigilance use a similarity in [0, 1] that compares whole
vectors:

    similarity(s, t) = 1 - |s - t| / (|s| + |t| + 1)            (s, t in units of the noise)

It is 1 for equality only, falls towards 0 for opposite directions and for very different lengths, is continuous in the
angle, and treats vectors below the noise as alike. Neuron 0 is the background, fixed at zero, and competes first.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from motion_detect_ros.core.clustering.alternatives.art2_classic import Art2Classic
from motion_detect_ros.core.clustering.art2_network import CONTESTED, MAX_PASSES, NOT_PRESENTED, Art2Network, LabelArray
from motion_detect_ros.core.config import Art2Config
from motion_detect_ros.core.kernels import kernel
from motion_detect_ros.core.types import DoubleArray, FloatArray

__all__ = ['MAX_PASSES', 'NOT_PRESENTED', 'Art2', 'LabelArray', 'make_art2', 'similarity']

#: Initial neurons are spread over vectors whose match with the background is under this (longer than 4 noise units).
CLEARLY_MOVING = 0.2
#: Share of the length up to which only the background is looked at; closer to it rounding decides.
SURELY = 0.999


def make_art2(config: Art2Config) -> Art2Network[Any]:
    """An empty network of the variant ``config.variant``."""
    return Art2Classic(config) if config.variant == 'classic' else Art2(config)


@dataclass(frozen=True)
class Presented:
    """``vectors``: (N, D), all finite; ``columns``: (D, N) the same; ``length``, ``background_match``: (N,).

    ``scratch``: (N,) each, of the search.
    """

    vectors: FloatArray
    columns: FloatArray
    length: FloatArray
    background_match: DoubleArray
    scratch: tuple[FloatArray, DoubleArray, LabelArray]


class Art2(Art2Network[Presented]):
    """The variant that keeps magnitude; a neuron's prototype is the mean of what it won. Source: see the module."""

    clearly_moving = CLEARLY_MOVING

    def __init__(self, config: Art2Config) -> None:
        super().__init__(config)
        self.spread_match = config.spread_match

    def use_config(self, config: Art2Config) -> None:
        """As ``Art2Network``."""
        super().use_config(config)
        self.spread_match = config.spread_match

    def _decided(self, vectors: FloatArray) -> LabelArray:
        """Shorter than any length at which another neuron is looked at; close to that the search decides.

        The match with the background is 1 / (length + 1).
        """
        labels = np.empty(len(vectors), np.int32)
        longest = 1.0 / max(self._config.vigilance, CLEARLY_MOVING) - 1.0
        _decide(vectors, SURELY * longest, labels)
        return labels

    def _feed(self, vectors: FloatArray) -> Presented:
        length = _lengths(vectors)
        wide = length.astype(np.float64)
        scratch = np.empty(len(length), np.float32), np.empty(len(length)), np.empty(len(length), np.int32)
        return Presented(vectors, np.ascontiguousarray(vectors.T), length,
                         1.0 - wide / (wide + 1.0), scratch)  # the background's length is 0

    def _compete(self, f1: Presented, labels: LabelArray, match: FloatArray) -> int:
        return int(_compete(
            f1.columns, f1.length, f1.background_match, self.prototypes, _lengths(self.prototypes),
            self._config.vigilance, labels, match, f1.scratch))

    def _compete_new(self, f1: Presented, labels: LabelArray, match: FloatArray) -> None:
        _compete_new(f1.columns, f1.length, f1.background_match, self.prototypes, _lengths(self.prototypes),
                     self._config.vigilance, labels, match, f1.scratch)

    def _commitment(self, f1: Presented, index: int) -> FloatArray:
        return f1.vectors[index]

    def _learn(self, f1: Presented, labels: LabelArray) -> None:
        prototypes = self.prototypes
        _learn(f1.vectors, labels, prototypes, self._config.learning_rate, np.zeros(len(prototypes), np.int64),
               np.zeros(prototypes.shape))

    def _pair_matches(self) -> DoubleArray:
        prototypes = self.prototypes.astype(np.float64)
        length = np.linalg.norm(prototypes, axis=1)
        distance = np.linalg.norm(prototypes[:, None] - prototypes, axis=2)
        matches: DoubleArray = 1.0 - distance / (length[:, None] + length + 1.0)
        return matches


def _lengths(vectors: FloatArray) -> FloatArray:
    """(N,) of each row, NaN where it is not finite."""
    length = np.empty(len(vectors), np.float32)
    _fill_lengths(vectors, length)
    return length


@kernel()
def similarity(sx, sy, tx, ty):  # type: ignore[no-untyped-def]
    """Match of an input with a prototype, in [0, 1]; see the module's docstring."""
    distance = np.sqrt((sx - tx) ** 2 + (sy - ty) ** 2)
    return 1.0 - distance / (np.sqrt(sx * sx + sy * sy) + np.sqrt(tx * tx + ty * ty) + 1.0)


@kernel()
def _fill_lengths(vectors, length):  # type: ignore[no-untyped-def]
    """``length``: (N,) of each row, NaN where it is not finite."""
    for i in range(vectors.shape[0]):
        total = np.float32(0.0)
        for d in range(vectors.shape[1]):
            total += vectors[i, d] * vectors[i, d]
        length[i] = np.sqrt(total) if np.isfinite(total) else np.nan


@kernel()
def _decide(vectors, longest, labels):  # type: ignore[no-untyped-def]
    """``labels``: ``NOT_PRESENTED``, or 0 where a vector is shorter than ``longest``, or ``CONTESTED``."""
    bound = longest * longest
    for i in range(vectors.shape[0]):
        total = np.float32(0.0)
        for d in range(vectors.shape[1]):
            total += vectors[i, d] * vectors[i, d]
        if total < bound:
            labels[i] = 0
        else:
            labels[i] = CONTESTED if np.isfinite(total) else NOT_PRESENTED


@kernel(error_model='numpy')
def _distances(columns, prototype, distance):  # type: ignore[no-untyped-def]
    """``distance``: (N,) of every vector from (D,) ``prototype``. One component at a time, as vector units like it."""
    for i in range(len(distance)):
        distance[i] = np.float32(0.0)
    for d in range(len(columns)):
        column = columns[d]
        for i in range(len(distance)):
            difference = column[i] - prototype[d]
            distance[i] += difference * difference
    for i in range(len(distance)):
        distance[i] = np.sqrt(distance[i])


@kernel(error_model='numpy')
def _compete(  # type: ignore[no-untyped-def]
    columns, length, background_match, prototypes, prototype_length, vigilance, labels, match, scratch,
):
    """F2: background first, then the best of the others; returns how many labels changed.

    ``match`` becomes the best match with any neuron, whoever wins: novelty must not depend on the vigilance.
    columns: (D, N), all finite; scratch: as ``Presented``.
    """
    distance, best_match, best = scratch
    for i in range(len(best)):
        best_match[i], best[i] = background_match[i], 0
    for j in range(1, prototypes.shape[0]):
        _distances(columns, prototypes[j], distance)
        prototype_size = prototype_length[j]
        for i in range(len(best)):
            m = 1.0 - distance[i] / (length[i] + prototype_size + 1.0)
            better = m > best_match[i]
            best_match[i] = m if better else best_match[i]
            best[i] = np.int32(j) if better else best[i]
    changed = 0
    for i in range(len(best)):
        resonates = background_match[i] >= vigilance
        winner = np.int32(0) if resonates else best[i]
        changed += labels[i] != winner
        labels[i] = winner
        match[i] = background_match[i] if resonates and background_match[i] >= CLEARLY_MOVING else best_match[i]
    return changed


@kernel()
def _compete_new(  # type: ignore[no-untyped-def]
    columns, length, background_match, prototypes, prototype_length, vigilance, labels, match, scratch,
):
    """The newest neuron takes the vectors it matches best, but none that resonates with the background."""
    new = prototypes.shape[0] - 1
    distance = scratch[0]
    _distances(columns, prototypes[new], distance)
    for i in range(len(distance)):
        m = 1.0 - distance[i] / (length[i] + prototype_length[new] + 1.0)
        if m > match[i]:
            match[i] = m
            if background_match[i] < vigilance:
                labels[i] = new


@kernel()
def _learn(vectors, labels, prototypes, rate, count, total):  # type: ignore[no-untyped-def]
    """Resonance: every neuron but the background moves towards the mean of the vectors it won.

    count, total: (K,) and (K, D) zeros.
    """
    for i in range(vectors.shape[0]):
        j = labels[i]
        if j > 0:
            count[j] += 1
            for d in range(vectors.shape[1]):
                total[j, d] += vectors[i, d]
    for j in range(1, prototypes.shape[0]):
        if count[j] > 0:
            for d in range(prototypes.shape[1]):
                prototypes[j, d] += rate * (total[j, d] / count[j] - prototypes[j, d])
