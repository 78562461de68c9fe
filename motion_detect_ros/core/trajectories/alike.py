"""Whether two points, or two parts of a body, moved alike over the longest baseline that both have."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np
import numpy.typing as npt

from motion_detect_ros.core.kernels import kernel
from motion_detect_ros.core.types import BoolArray, DoubleArray, FloatArray

#: Displacements of two points of one object differ by no more than this, pixels and share of the smaller one: error of
#: the tracker, turns and perspective.
ALIKE_PX, ALIKE_SHARE = 1.0, 0.04
#: A course has turned by what an error of its halves of so many pixels does not explain; the most that counts, radians.
COURSE_PX, MAX_TURN = 0.5, 0.5

Numbers = npt.NDArray[np.intp]


def moved_alike(displacements: Sequence[DoubleArray], pairs: Numbers) -> BoolArray:
    """(n,) mask of pairs (n, 2) of points (Brox and Malik 2010).

    displacements: (N, 2) each, longest baseline first, NaN where unknown.
    """
    alike = np.zeros(len(pairs), np.bool_)
    if len(displacements):
        _compare(np.array(displacements), pairs, ALIKE_PX, alike)
    return alike


@kernel()
def _compare(displacements, pairs, alike_px, alike):  # type: ignore[no-untyped-def]
    """displacements: (baselines, N, 2); alike_px: ``ALIKE_PX``, which a kernel would keep as it was when compiled."""
    for number in range(len(pairs)):
        one, other = pairs[number]
        for way in displacements:
            apart = math.hypot(way[one, 0] - way[other, 0], way[one, 1] - way[other, 1])
            if not math.isnan(apart):
                alike[number] = apart < _limit(way, one, other, alike_px)
                break


def moved_as_one_body(
    displacements: Sequence[DoubleArray], inner: DoubleArray, seconds: Sequence[float], centres: DoubleArray,
    pairs: Numbers,
) -> BoolArray:
    """(n,) mask of pairs (n, 2) of parts at centres (N, 2): as ``moved_alike``, or as parts of what turns or grows.

    Across the line between two parts of a turning body their ways differ by the angle times the distance: it turns as
    its course does, that of both together, or as its parts do. Along it they differ by up to what the parts grow, for a
    camera that comes closer or a slanted view. seconds: (baselines,) of the displacements; inner: see ``inner_motion``.
    """
    alike = np.zeros(len(pairs), np.bool_)
    if len(displacements):
        periods = np.array(seconds)
        halves = np.abs(periods[:, None] / 2.0 - periods).argmin(axis=1)
        _compare_parts(np.array(displacements), inner, halves, centres, np.ascontiguousarray(pairs), ALIKE_PX, alike)
    return alike


def inner_motion(displacements: Sequence[DoubleArray], places: FloatArray, owner: Numbers, parts: int) -> DoubleArray:
    """(baselines, parts, 3) how the points within each part move against each other: its growth and its turn, radians,
    are the first two over the third.

    Sums about their means: of places times ways, along and across, and of squared places, pixels^2; 0 where under two
    points are known. displacements: (N, 2) each, NaN where unknown, of points at places (N, 2) of owners (N,).
    """
    inner, means = np.zeros((len(displacements), parts, 3)), np.empty((parts, 5))
    for ways, sums in zip(displacements, inner, strict=True):
        _moved_within(ways, places, owner, means, sums)
    return inner


@kernel()
def _moved_within(ways, places, owner, means, sums):  # type: ignore[no-untyped-def]
    """means: (parts, 5) to work in; sums: (parts, 3) zeros."""
    means[:] = 0.0
    for point in range(len(owner)):
        if not math.isnan(ways[point, 0]):
            of = means[owner[point]]
            of[0] += 1.0
            of[1] += places[point, 0]
            of[2] += places[point, 1]
            of[3] += ways[point, 0]
            of[4] += ways[point, 1]
    for point in range(len(owner)):
        if not math.isnan(ways[point, 0]):
            of, out = means[owner[point]], sums[owner[point]]
            x, y = places[point, 0] - of[1] / of[0], places[point, 1] - of[2] / of[0]
            way_x, way_y = ways[point, 0] - of[3] / of[0], ways[point, 1] - of[4] / of[0]
            out[0] += x * way_x + y * way_y
            out[1] += x * way_y - y * way_x
            out[2] += x * x + y * y


@kernel()
def _compare_parts(displacements, inner, halves, centres, pairs, alike_px, alike):  # type: ignore[no-untyped-def]
    """displacements: (baselines, P, 2); halves: (baselines,) which of them is about half as long."""
    for number in range(len(pairs)):
        one, other = pairs[number]
        for index, way in enumerate(displacements):
            x, y = way[one, 0] - way[other, 0], way[one, 1] - way[other, 1]
            if math.isnan(x):
                continue
            half = displacements[halves[index]]
            later_x, later_y = (half[one, 0] + half[other, 0]) / 2.0, (half[one, 1] + half[other, 1]) / 2.0
            whole_x, whole_y = (way[one, 0] + way[other, 0]) / 2.0, (way[one, 1] + way[other, 1]) / 2.0
            line_x = centres[one, 0] - centres[other, 0] - x / 2.0  # as it was on the way
            line_y = centres[one, 1] - centres[other, 1] - y / 2.0
            square = line_x * line_x + line_y * line_y
            distance = math.sqrt(square)
            here, there = inner[index, one], inner[index, other]
            spread = here[2] + there[2]
            times = square / spread if spread > 0.0 else 0.0
            grown, turned = (here[0] + there[0]) * times, (here[1] + there[1]) * times
            along, across = x * line_x + y * line_y, line_x * y - line_y * x
            limit = _limit(way, one, other, alike_px)
            turned_px = _turn(whole_x - later_x, whole_y - later_y, later_x, later_y) * distance
            grows = min(0.0, grown) - limit * distance < along < max(0.0, grown) + limit * distance
            turns = abs(across) < (limit + turned_px) * distance or abs(across - turned) < limit * distance
            alike[number] = (grows and turns) or math.hypot(x, y) < limit
            break


@kernel()
def _limit(way, one, other, alike_px):  # type: ignore[no-untyped-def]
    """Most that two displacements, known, of one object differ by, pixels."""
    return alike_px + ALIKE_SHARE * min(math.hypot(way[one, 0], way[one, 1]), math.hypot(way[other, 0], way[other, 1]))


@kernel()
def _turn(x, y, later_x, later_y):  # type: ignore[no-untyped-def]
    """Radians over both halves of a way, twice what their directions differ by; 0 where that is not certain or
    known.
    """
    first, second = math.hypot(x, y), math.hypot(later_x, later_y)
    angle = abs(math.atan2(x * later_y - y * later_x, x * later_x + y * later_y))
    if first > 0.0 and second > 0.0 and angle > COURSE_PX / first + COURSE_PX / second:
        return min(2.0 * angle, MAX_TURN)
    return 0.0
