"""ART2 clustering of motion vectors, the variant that keeps magnitude.

The stages are those of adaptive resonance theory (Carpenter and Grossberg 1987; Fausett 1994, section 5.3): an input
is presented, F2 neurons compete for it, the winner is tested against the vigilance, resonance makes the winner learn,
reset of every winner commits a new neuron. ART2's normalisation drops the magnitude, so two speeds in one direction
would be one class; here match and vigilance use a similarity in [0, 1] that compares whole vectors:

    similarity(s, t) = 1 - |s - t| / (|s| + |t| + 1)            (s, t in units of the noise)

It is 1 for equality only, falls towards 0 for opposite directions and for very different lengths, has no seam in the
angle, and treats vectors below the noise as alike. Neuron 0 is the background, fixed at zero, and competes first.

Inputs are presented most novel first (farthest-first, Gonzalez 1985): the vector that the committed neurons match
worst is the next one presented. The order does not depend on the raster, and as it does not depend on the vigilance
either, a higher vigilance never gives fewer neurons.
"""

from __future__ import annotations

import numba
import numpy as np
import numpy.typing as npt

from motion_detect_ros.core.config import Art2Config
from motion_detect_ros.core.types import FloatArray

LabelArray = npt.NDArray[np.int32]

#: Label of a vector that was not presented (invalid flow).
NOT_PRESENTED = -1
#: Learning passes over a frame; assignments settle after two to four.
MAX_PASSES = 5
#: Below this worst match the initial neurons still spread out, above it the vectors are one motion.
SPREAD_MATCH = 0.6
#: Initial neurons are spread over vectors whose match with the background is under this (longer than 4 noise units).
CLEARLY_MOVING = 0.2


class Art2:
    """The clustering memory: neurons (prototypes) that persist from frame to frame."""

    def __init__(self, config: Art2Config) -> None:
        self._config = config
        self.reset()

    def reset(self) -> None:
        """Forget all neurons but the background."""
        self.prototypes: FloatArray = np.zeros((1, 2), np.float32)
        self._idle = np.zeros(1, np.int32)
        self._names = np.zeros(1, np.uint32)
        self._next_name = 1

    @property
    def names(self) -> npt.NDArray[np.uint32]:
        """(K,) number of each neuron, stable over frames; 0 is the background."""
        return self._names

    def partial_fit(self, vectors: FloatArray) -> LabelArray:
        """Present one frame's vectors; returns (N,) int32 index into ``prototypes`` of each one's neuron.

        vectors: (N, 2) float32 in units of the noise; NaN rows are not presented (``NOT_PRESENTED``).
        """
        config = self._config
        self._forget_idle()
        vectors = np.ascontiguousarray(vectors, np.float32)
        labels = np.empty(len(vectors), np.int32)
        match = np.empty(len(vectors), np.float32)
        _compete(vectors, self.prototypes, config.vigilance, labels, match)
        self._commit(vectors, labels, match)
        for _ in range(MAX_PASSES):
            _learn(vectors, labels, self.prototypes, config.learning_rate)
            if not _compete(vectors, self.prototypes, config.vigilance, labels, match):
                break
        wins = np.bincount(labels[labels >= 0], minlength=len(self.prototypes))
        self._idle = np.where(wins > 0, 0, self._idle + 1).astype(np.int32)
        return labels

    def _commit(self, vectors: FloatArray, labels: LabelArray, match: FloatArray) -> None:
        """Spread the initial neurons over what clearly moves, then grow while any vector fails the vigilance."""
        config = self._config
        self._present(vectors, labels, match, config.initial_neurons, SPREAD_MATCH, CLEARLY_MOVING)
        self._present(vectors, labels, match, config.max_neurons, config.vigilance, 1.0)

    def _present(
        self, vectors: FloatArray, labels: LabelArray, match: FloatArray,
        neurons: int, required_match: float, background_match: float,
    ) -> None:
        """Present the most novel vector, commit a neuron to it, until all match or ``neurons`` are committed."""
        while len(self.prototypes) < neurons:
            novel, novel_match = _most_novel(vectors, match, background_match)
            if novel < 0 or novel_match >= required_match:
                return
            self.prototypes = np.vstack([self.prototypes, vectors[novel:novel + 1]])
            self._names = np.append(self._names, np.uint32(self._next_name))
            self._idle = np.append(self._idle, np.int32(0))
            self._next_name += 1
            _compete_new(vectors, self.prototypes, self._config.vigilance, labels, match)

    def _forget_idle(self) -> None:
        keep = self._idle < self._config.forget_frames
        keep[0] = True
        self.prototypes, self._names, self._idle = self.prototypes[keep], self._names[keep], self._idle[keep]


@numba.njit(cache=True, nogil=True, fastmath=False)
def similarity(sx, sy, tx, ty):  # type: ignore[no-untyped-def]
    """Match of an input with a prototype, in [0, 1]; see the module's docstring."""
    distance = np.sqrt((sx - tx) ** 2 + (sy - ty) ** 2)
    return 1.0 - distance / (np.sqrt(sx * sx + sy * sy) + np.sqrt(tx * tx + ty * ty) + 1.0)


@numba.njit(cache=True, nogil=True)
def _compete(vectors, prototypes, vigilance, labels, match):  # type: ignore[no-untyped-def]
    """F2: background first, then the best of the others; returns how many labels changed.

    ``match`` becomes the best match with any neuron, whoever wins: novelty must not depend on the vigilance.
    """
    changed = 0
    for i in range(vectors.shape[0]):
        sx, sy = vectors[i, 0], vectors[i, 1]
        best, best_match = -1, np.float32(0.0)
        if np.isfinite(sx) and np.isfinite(sy):
            best, best_match = 0, similarity(sx, sy, prototypes[0, 0], prototypes[0, 1])
            resonates = best_match >= vigilance
            if not resonates or best_match < CLEARLY_MOVING:
                for j in range(1, prototypes.shape[0]):
                    m = similarity(sx, sy, prototypes[j, 0], prototypes[j, 1])
                    if m > best_match:
                        best_match = m
                        if not resonates:
                            best = j
        if labels[i] != best:
            changed += 1
        labels[i], match[i] = best, best_match
    return changed


@numba.njit(cache=True, nogil=True)
def _compete_new(vectors, prototypes, vigilance, labels, match):  # type: ignore[no-untyped-def]
    """The newest neuron takes the vectors it matches best, but none that resonates with the background."""
    new = prototypes.shape[0] - 1
    tx, ty = prototypes[new, 0], prototypes[new, 1]
    for i in range(vectors.shape[0]):
        if labels[i] >= 0:
            m = similarity(vectors[i, 0], vectors[i, 1], tx, ty)
            if m > match[i]:
                match[i] = m
                if similarity(vectors[i, 0], vectors[i, 1], 0.0, 0.0) < vigilance:
                    labels[i] = new


@numba.njit(cache=True, nogil=True)
def _most_novel(vectors, match, background_match):  # type: ignore[no-untyped-def]
    """Index and match of the worst-matched vector among those that match the background less than given."""
    novel, lowest = -1, np.float32(2.0)
    for i in range(vectors.shape[0]):
        moves = similarity(vectors[i, 0], vectors[i, 1], 0.0, 0.0) < background_match  # False for NaN
        if moves and match[i] < lowest:
            novel, lowest = i, match[i]
    return novel, lowest


@numba.njit(cache=True, nogil=True)
def _learn(vectors, labels, prototypes, rate):  # type: ignore[no-untyped-def]
    """Resonance: every neuron but the background moves towards the mean of the vectors it won."""
    count = np.zeros(prototypes.shape[0], np.int64)
    total = np.zeros(prototypes.shape, np.float64)
    for i in range(vectors.shape[0]):
        j = labels[i]
        if j > 0:
            count[j] += 1
            total[j, 0] += vectors[i, 0]
            total[j, 1] += vectors[i, 1]
    for j in range(1, prototypes.shape[0]):
        if count[j] > 0:
            for d in range(2):
                prototypes[j, d] += rate * (total[j, d] / count[j] - prototypes[j, d])
