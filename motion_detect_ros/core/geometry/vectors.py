"""Two-component vectors, one and many."""

from __future__ import annotations

from typing import TypeVar

import numpy as np

from motion_detect_ros.core.types import DoubleArray, FloatArray

Vectors = TypeVar('Vectors', FloatArray, DoubleArray)
#: x and y of a single vector: plain numbers are several times faster than an array of two.
Pair = tuple[float, float]


def magnitude(vectors: Vectors) -> Vectors:
    """(...) length of (..., 2) vectors, in their unit."""
    length: Vectors = np.hypot(vectors[..., 0], vectors[..., 1])
    return length


def pair(vector: DoubleArray) -> Pair:
    """The plain numbers of a (2,) vector."""
    x, y = vector.tolist()
    return x, y
