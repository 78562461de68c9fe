"""Base of the ART2 variants: neurons that persist over frames, growth, learning passes, merging, forgetting.

A variant defines how vectors become F1 activities, how well they match a neuron and how a neuron learns; the search
is the same. Neuron 0 is the background, fixed at zero.

Inputs that commit neurons are presented most novel first (farthest-first, Gonzalez 1985): the next one is the vector
with the worst match with the committed neurons. The order depends neither on the raster nor on the vigilance, so a
higher vigilance never gives fewer neurons (one frame, empty network, nothing merged).
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from typing import Generic, Protocol, TypeVar

import numpy as np
import numpy.typing as npt

from motion_detect_ros.core.config import Art2Config
from motion_detect_ros.core.errors import MotionDetectError
from motion_detect_ros.core.kernels import kernel
from motion_detect_ros.core.types import MAX_ID, DoubleArray, FloatArray

LabelArray = npt.NDArray[np.int32]
#: Label of a vector that is not presented (invalid flow).
NOT_PRESENTED = -1
#: Label of a vector that neurons compete for, until one has won; most vectors are the background's whatever there is.
CONTESTED = 1
#: Maximum number of learning passes over a frame; assignments settle after two to four.
MAX_PASSES = 5
#: Default frame period, and rounding tolerance of sums of periods, seconds.
PERIOD_S = 0.04


class VectorsError(MotionDetectError, ValueError):
    """Vectors of the wrong shape."""


class Fed(Protocol):
    """A frame as F1 passes it to F2.

    ``vectors``: (N, D) float32, what was presented; ``background_match``: (N,) match with the background,
    NaN = not presented.
    """

    @property
    def vectors(self) -> FloatArray:
        """(N, D) float32."""

    @property
    def background_match(self) -> DoubleArray:
        """(N,) float64."""


F1 = TypeVar('F1', bound=Fed)


class Art2Network(ABC, Generic[F1]):
    """A network of neurons (prototypes) that persist from frame to frame.

    ``prototypes``: (K, D) float32, row 0 the background.
    """

    #: Initial neurons are committed until the worst match reaches this.
    spread_match: float
    #: Initial neurons are committed to vectors whose match with the background is under this.
    clearly_moving: float

    def __init__(self, config: Art2Config) -> None:
        self._config = config
        self.reset()

    def use_config(self, config: Art2Config) -> None:
        """Settings from the next frame on, for the neurons that there are; another variant needs another network."""
        self._config = config

    def reset(self) -> None:
        """Clear all neurons but the background; names restart at 1."""
        self._next_name = 1
        self._clear(2)

    def _clear(self, dimension: int) -> None:
        self.prototypes: FloatArray = np.zeros((1, dimension), np.float32)
        self._idle_s = np.zeros(1)
        self._names = np.zeros(1, np.uint32)

    @property
    def names(self) -> npt.NDArray[np.uint32]:
        """(K,) number of each neuron, stable over frames; 0 is the background."""
        return self._names

    def partial_fit(self, vectors: FloatArray, dt_s: float = PERIOD_S) -> LabelArray:
        """Present one frame's vectors; returns (N,) int32 index into ``prototypes`` of each one's neuron.

        vectors: (N, D) float32 in units of the noise; rows that are not finite are not presented (``NOT_PRESENTED``).
        dt_s: time since the frame before, seconds.
        Raises: VectorsError for another shape, or another D than that of the committed neurons.
        """
        vectors = self._checked(vectors)
        self._forget_idle(dt_s)
        labels = self._decided(vectors)
        contested = np.flatnonzero(labels == CONTESTED)
        labels[contested] = self._fitted(vectors[contested], dt_s)
        return labels

    def _fitted(self, vectors: FloatArray, dt_s: float) -> LabelArray:
        f1 = self._feed(vectors)
        labels = np.empty(len(vectors), np.int32)
        match = np.empty(len(vectors), np.float32)
        self._compete(f1, labels, match)
        self._grow(f1, labels, match)
        for _ in range(MAX_PASSES):
            self._learn(f1, labels)
            if not self._compete(f1, labels, match):
                break
        if self._merge(labels):
            self._compete(f1, labels, match)
        wins = np.bincount(labels[labels >= 0], minlength=len(self.prototypes))
        self._idle_s = np.where(wins > 0, 0.0, self._idle_s + dt_s)
        return labels

    def predict(self, vectors: FloatArray) -> LabelArray:
        """Labels as ``partial_fit`` gives them, but nothing is learned: the nearest neuron wins where none resonates.

        Raises: VectorsError as ``partial_fit``.
        """
        vectors = self._checked(vectors)
        labels = self._decided(vectors)
        contested = np.flatnonzero(labels == CONTESTED)
        won = np.empty(len(contested), np.int32)
        self._compete(self._feed(vectors[contested]), won, np.empty(len(contested), np.float32))
        labels[contested] = won
        return labels

    def _decided(self, vectors: FloatArray) -> LabelArray:
        """(N,) int32: ``NOT_PRESENTED``, 0 where the background wins whatever neurons there are, else ``CONTESTED``."""
        return np.full(len(vectors), CONTESTED, np.int32)

    @abstractmethod
    def _feed(self, vectors: FloatArray) -> F1:
        """F1's activities for every vector, without feedback from F2."""

    @abstractmethod
    def _compete(self, f1: F1, labels: LabelArray, match: FloatArray) -> int:
        """F2 for every vector: winner, and best match with any neuron; returns how many labels changed."""

    @abstractmethod
    def _compete_new(self, f1: F1, labels: LabelArray, match: FloatArray) -> None:
        """Assign to the newest neuron the vectors that it matches best."""

    @abstractmethod
    def _commitment(self, f1: F1, index: int) -> FloatArray:
        """(D,) prototype of a new neuron committed to one vector."""

    @abstractmethod
    def _learn(self, f1: F1, labels: LabelArray) -> None:
        """One learning pass over the frame."""

    @abstractmethod
    def _pair_matches(self) -> DoubleArray:
        """(K, K) match of every neuron with every other."""

    def _grow(self, f1: F1, labels: LabelArray, match: FloatArray) -> None:
        """Commit the initial neurons to what clearly moves, then grow while any vector fails the vigilance."""
        config = self._config
        self._commit_novel(f1, labels, match, config.initial_neurons, self.spread_match, self.clearly_moving)
        self._commit_novel(f1, labels, match, config.max_neurons, config.vigilance, 1.0)

    def _commit_novel(
        self, f1: F1, labels: LabelArray, match: FloatArray,
        neurons: int, required_match: float, below: float,
    ) -> None:
        """Commit a neuron to the most novel vector, until all match or ``neurons`` are committed."""
        while len(self.prototypes) < neurons:
            novel, novel_match = _most_novel(f1.vectors, f1.background_match, match, below)
            if novel < 0 or novel_match >= required_match:
                return
            self.prototypes = np.vstack([self.prototypes, self._commitment(f1, novel)])
            self._names = np.append(self._names, np.uint32(self._next_name))
            self._idle_s = np.append(self._idle_s, 0.0)
            self._next_name = self._next_name % MAX_ID + 1
            self._compete_new(f1, labels, match)

    def _merge(self, labels: LabelArray) -> bool:
        """Join duplicates, best match first: the older neuron stays, at the mean weighted by wins."""
        if self._config.merge_match >= 1.0:
            return False
        wins = np.bincount(labels[labels > 0], minlength=len(self.prototypes)).astype(np.float64)
        merged = False
        while len(self.prototypes) > 2:
            pairs = np.triu(self._pair_matches()[1:, 1:], 1)
            older, newer = (1 + int(index) for index in np.unravel_index(pairs.argmax(), pairs.shape))
            if pairs[older - 1, newer - 1] <= self._config.merge_match:
                break
            both = wins[older] + wins[newer]
            if both > 0:
                share = np.float32(wins[newer] / both)
                self.prototypes[older] += share * (self.prototypes[newer] - self.prototypes[older])
                self._idle_s[older] = 0.0
            wins[older] = both
            keep = np.arange(len(self.prototypes)) != newer
            wins = wins[keep]
            self._keep(keep)
            merged = True
        return merged

    def _forget_idle(self, dt_s: float) -> None:
        keep = self._idle_s < self._config.forget_s - 0.5 * dt_s  # to the nearest frame
        keep |= self._idle_s == 0.0  # it has won in the last one
        keep[0] = True
        self._keep(keep)

    def _keep(self, keep: npt.NDArray[np.bool_]) -> None:
        self.prototypes, self._names, self._idle_s = self.prototypes[keep], self._names[keep], self._idle_s[keep]

    def _checked(self, vectors: FloatArray) -> FloatArray:
        """``vectors`` as contiguous float32; an empty network accepts any dimension."""
        vectors = np.ascontiguousarray(vectors, np.float32)
        if vectors.ndim != 2 or vectors.shape[1] == 0:
            raise VectorsError(f'vectors: expected shape (N, D), got {vectors.shape}')
        dimension = self.prototypes.shape[1]
        if vectors.shape[1] != dimension and len(self.prototypes) > 1:
            raise VectorsError(f'vectors: expected shape (N, {dimension}) as before, got {vectors.shape}')
        if vectors.shape[1] != dimension:
            self._clear(vectors.shape[1])
        return vectors


@kernel()
def _most_novel(vectors, background_match, match, below):  # type: ignore[no-untyped-def]
    """Index (-1: none) and match of the worst-matched vector of those that match the background by less than given.

    Of equally novel vectors the one with the smaller components, whatever the raster.
    """
    novel, lowest = np.int64(-1), np.float32(2.0)  # for -1 as such _precedes would be compiled again
    for i in range(vectors.shape[0]):
        if not background_match[i] < below or match[i] > lowest:  # NaN is not presented
            continue
        if novel < 0 or match[i] < lowest or _precedes(vectors, i, novel):
            novel, lowest = np.int64(i), match[i]
    return novel, lowest


@kernel()
def _precedes(vectors, i, j):  # type: ignore[no-untyped-def]
    """Lexicographic order of rows."""
    for d in range(vectors.shape[1]):
        if vectors[i, d] != vectors[j, d]:
            return vectors[i, d] < vectors[j, d]
    return False
