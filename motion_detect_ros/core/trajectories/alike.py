"""Whether two points, or two parts of a body, moved alike over the longest baseline that both have."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import numpy.typing as npt

from motion_detect_ros.core.geometry.vectors import magnitude
from motion_detect_ros.core.types import BoolArray, DoubleArray

#: Displacements of two points of one object differ by no more than this, pixels and share of the smaller one: error of
#: the tracker, turns and perspective.
ALIKE_PX, ALIKE_SHARE = 1.0, 0.04
#: A course has turned by what an error of its halves of so many pixels does not explain; the most that counts, radians.
COURSE_PX, MAX_TURN = 0.5, 0.5

Pairs = npt.NDArray[np.intp]


def moved_alike(displacements: Sequence[DoubleArray], pairs: Pairs) -> BoolArray:
    """(n,) mask of pairs (n, 2) of points (Brox and Malik 2010).

    displacements: (N, 2) each, longest baseline first, NaN where unknown.
    """
    alike, known = np.zeros(len(pairs), np.bool_), np.zeros(len(pairs), np.bool_)
    for way in displacements:
        one, other = way[pairs[:, 0]], way[pairs[:, 1]]
        limit = _limit(one, other)
        with np.errstate(invalid='ignore'):
            alike |= ~known & (magnitude(one - other) < limit)
        known |= np.isfinite(limit)
    return alike


def moved_as_one_body(
    displacements: Sequence[DoubleArray], seconds: Sequence[float], centres: DoubleArray, pairs: Pairs,
) -> BoolArray:
    """(n,) mask of pairs (n, 2) of parts at centres (N, 2): as ``moved_alike``, or as parts of what turns.

    Across the line between two parts of a turning body their ways differ by the angle times the distance, along it they
    do not. It turns as its course does, that of both together. seconds: of the displacements' baselines.
    """
    alike, known = np.zeros(len(pairs), np.bool_), np.zeros(len(pairs), np.bool_)
    now = centres[pairs[:, 0]] - centres[pairs[:, 1]]
    for way, period_s in zip(displacements, seconds, strict=False):
        half = min(range(len(displacements)), key=lambda index: abs(seconds[index] - period_s / 2.0))
        one, other = way[pairs[:, 0]], way[pairs[:, 1]]
        apart, limit, later = one - other, _limit(one, other), displacements[half][pairs].mean(axis=1)
        line = now - apart / 2.0  # as it was on the way
        distance = magnitude(line)
        turned_px = _turn((one + other) / 2.0 - later, later) * distance
        with np.errstate(invalid='ignore'):
            turned = ((np.abs((apart * line).sum(axis=1)) < limit * distance)
                      & (np.abs(_cross(apart, line)) < (limit + turned_px) * distance))
            near = turned | (magnitude(apart) < limit)
        alike |= ~known & near
        known |= np.isfinite(limit)
    return alike


def _limit(one: DoubleArray, other: DoubleArray) -> DoubleArray:
    limit: DoubleArray = ALIKE_PX + ALIKE_SHARE * np.minimum(magnitude(one), magnitude(other))
    return limit


def _turn(earlier: DoubleArray, later: DoubleArray) -> DoubleArray:
    """(n,) radians over both halves (n, 2) of a way, twice what their directions differ by; 0 where that is not
    certain or known.
    """
    with np.errstate(invalid='ignore', divide='ignore'):
        angle = np.abs(np.arctan2(_cross(earlier, later), (earlier * later).sum(axis=1)))
        certain = angle > COURSE_PX / magnitude(earlier) + COURSE_PX / magnitude(later)
    return np.where(certain, np.minimum(2.0 * angle, MAX_TURN), 0.0)


def _cross(one: DoubleArray, other: DoubleArray) -> DoubleArray:
    crossed: DoubleArray = one[:, 0] * other[:, 1] - one[:, 1] * other[:, 0]
    return crossed
