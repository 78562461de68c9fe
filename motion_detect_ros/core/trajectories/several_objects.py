"""Clusters that hold several objects: neighbours that drive alike and touch in the picture, by their shadows too.

Nothing between two such objects tells them apart; that a scene's objects are of a size does. What is larger than
nearly all of them, and fills its box worse than its two halves fill theirs, is two.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Sequence

import cv2
import numpy as np
import numpy.typing as npt

from motion_detect_ros.core.geometry.vectors import magnitude
from motion_detect_ros.core.types import NANOSECONDS, BoolArray, DoubleArray, FloatArray

#: So long objects are remembered, seconds; at least so many of one frame count.
MEMORY_S, LEAST_OBJECTS = 2.0, 5
#: Points see so far around their places, pixels: half of the tracker's window.
SEEN_PX = 4.0
#: The usual size is one that this share of the objects does not exceed: cars are usual among motorcycles, too.
USUAL_SHARE = 0.75
#: What holds several objects is larger than the usual size by this factor of the area, and the boxes of its halves have
#: at most this share of its own together.
LARGER, HALVES_SHARE = 1.6, 0.9
#: Halves whose ways differ by more than this share are those of one body that comes closer or turns: the ways of
#: neighbouring points differ by less, so it is large, and they change all over it.
GROWS_SHARE = 0.12
#: Fewest points of each half for which a baseline tells their way.
MIN_OLD = 3
#: Directions across the cuts that are tried: columns, rows and diagonals of the picture.
ACROSS_CUTS = np.array([[1.0, 0.0], [0.0, 1.0], [1.0, 1.0], [1.0, -1.0]], np.float32)

Numbers = npt.NDArray[np.intp]


class UsualSize:
    """``area``: which most objects of the last seconds do not exceed, pixels of the working resolution; None as long as
    too few were seen together.
    """

    def __init__(self) -> None:
        self.reset()

    def reset(self) -> None:
        """Another scene."""
        self._seen = deque[tuple[int, DoubleArray]]()
        self.area: float | None = None

    def add(self, bounds: Sequence[tuple[FloatArray, FloatArray]], stamp_ns: int) -> None:
        """Objects of one frame, the bounds of their points, (2,) low and high each, pixels; and its stamp."""
        if len(bounds) >= LEAST_OBJECTS:
            self._seen.append((stamp_ns, np.array([_area(low, high) for low, high in bounds])))
        while self._seen and self._seen[0][0] < stamp_ns - MEMORY_S * NANOSECONDS:
            self._seen.popleft()
        self.area = None
        if self._seen:
            self.area = float(np.quantile(np.concatenate([areas for _, areas in self._seen]), USUAL_SHARE))


def parted(
    members: Numbers, places: FloatArray, displacements: Sequence[DoubleArray], usual_area: float | None, least: int,
) -> list[Numbers]:
    """The members of each object of a cluster: all of them, or of several objects.

    It is cut along a column, a row or a diagonal of the picture, where the boxes of both halves are smallest; a long
    one that lies across them fills a rectangle of another direction. members: (n,) indices of points; places: (N, 2)
    of all points, pixels; displacements: (N, 2) each, pixels against the background over each baseline, NaN for points
    that are younger; usual_area: of ``UsualSize``; least: fewest points of an object.
    """
    own = places[members]
    area = _area(own.min(axis=0), own.max(axis=0))
    if usual_area is None or len(members) < 2 * least or area < LARGER * usual_area:
        return [members]
    first, of_halves = _cut(own, least)
    if of_halves > HALVES_SHARE * area or _turned_area(own[first]) + _turned_area(own[~first]) > _turned_area(own):
        return [members]
    halves = members[first], members[~first]
    if _grows(displacements, *halves):
        return [members]
    return [part for half in halves for part in parted(half, places, displacements, usual_area, least)]


def _cut(places: FloatArray, least: int) -> tuple[BoolArray, float]:
    """(n,) which places belong to the first of two halves of ``least`` at least, and the area of the halves' boxes."""
    found = list[tuple[float, Numbers]]()
    for along in ACROSS_CUTS:
        order = np.argsort(places @ along, kind='stable')
        in_order = places[order]
        before = _areas_up_to(in_order)[least - 1:len(places) - least]
        after = _areas_up_to(in_order[::-1])[::-1][least:len(places) - least + 1]
        best = int(np.argmin(before + after))
        found.append((float(before[best] + after[best]), order[:least + best]))
    area, half = min(found, key=lambda each: each[0])
    first = np.zeros(len(places), np.bool_)
    first[half] = True
    return first, area


def _areas_up_to(places: FloatArray) -> FloatArray:
    """(n,) area of the box of the first 1, 2, ... n places."""
    sides = np.maximum.accumulate(places) - np.minimum.accumulate(places) + 2.0 * SEEN_PX
    area: FloatArray = sides.prod(axis=1)
    return area


def _turned_area(places: FloatArray) -> float:
    """Area of the smallest rectangle of any direction."""
    _, (width, height), _ = cv2.minAreaRect(places)
    return float((width + 2.0 * SEEN_PX) * (height + 2.0 * SEEN_PX))


def _grows(displacements: Sequence[DoubleArray], one: Numbers, other: Numbers) -> bool:
    """Whether the halves' ways differ as the ends of one growing body do, over the longest baseline of both."""
    for ways in displacements:
        of_one, of_other = (ways[half][np.isfinite(ways[half, 0])] for half in (one, other))
        if min(len(of_one), len(of_other)) >= MIN_OLD:
            way = np.median(np.concatenate([of_one, of_other]), axis=0)
            step = np.median(of_one, axis=0) - np.median(of_other, axis=0)
            return bool(magnitude(step) > GROWS_SHARE * max(1.0, float(magnitude(way))))
    return False


def _area(low: FloatArray, high: FloatArray) -> float:
    return float((high - low + 2.0 * SEEN_PX).prod())
