"""Whether two points, or parts, moved alike over the longest baseline that both have (Brox and Malik 2010)."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import numpy.typing as npt

from motion_detect_ros.core.geometry.vectors import magnitude
from motion_detect_ros.core.types import BoolArray, DoubleArray

#: Displacements of two points of one object differ by no more than this, pixels and share of the smaller one: error of
#: the tracker, turns and perspective.
ALIKE_PX, ALIKE_SHARE = 1.0, 0.04


def moved_alike(displacements: Sequence[DoubleArray], pairs: npt.NDArray[np.intp]) -> BoolArray:
    """(n,) mask of pairs (n, 2) of numbers; displacements: (N, 2) each, longest baseline first, NaN where unknown."""
    alike, known = np.zeros(len(pairs), np.bool_), np.zeros(len(pairs), np.bool_)
    for way in displacements:
        one, other = way[pairs[:, 0]], way[pairs[:, 1]]
        length = np.minimum(magnitude(one), magnitude(other))
        with np.errstate(invalid='ignore'):
            near = magnitude(one - other) < ALIKE_PX + ALIKE_SHARE * length
        alike |= ~known & near
        known |= np.isfinite(length)
    return alike
