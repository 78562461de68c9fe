"""Clusters that hold several objects, and what one body that grows shows instead."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import numpy.typing as npt

from motion_detect_ros.core.detection.several_objects import box_area, halves
from motion_detect_ros.core.geometry.vectors import magnitude
from motion_detect_ros.core.types import DoubleArray, FloatArray

#: Points see so far around their places, pixels: half of the tracker's window.
SEEN_PX = 4.0
#: So many objects in a frame tell which size is usual.
LEAST_OBJECTS = 5
#: Halves whose ways differ by more than this share are those of one body that comes closer or turns: the ways of
#: neighbouring points differ by less, so it is large, and they change all over it.
GROWS_SHARE = 0.12
#: Fewest points of each half for which a baseline tells their way.
MIN_OLD = 3

Numbers = npt.NDArray[np.intp]


def parted(
    members: Numbers, places: FloatArray, displacements: Sequence[DoubleArray], usual_area: float | None, least: int,
) -> list[Numbers]:
    """The members of each object of a cluster: all of them, or of several objects.

    members: (n,) indices of points; places: (N, 2) of all points, pixels; displacements: (N, 2) each, pixels against
    the background over each baseline, NaN for points that are younger; usual_area: of ``seen_area``; least: fewest
    points of an object.
    """
    if usual_area is None or (first := halves(places[members], usual_area, least, SEEN_PX)) is None:
        return [members]
    one, other = members[first], members[~first]
    if _grows(displacements, one, other):
        return [members]
    return [part for half in (one, other) for part in parted(half, places, displacements, usual_area, least)]


def seen_area(low: FloatArray, high: FloatArray) -> float:
    """Of a cluster with these bounds, (2,) pixels."""
    return box_area(low, high, SEEN_PX)


def _grows(displacements: Sequence[DoubleArray], one: Numbers, other: Numbers) -> bool:
    """Whether the halves' ways differ as the ends of one growing body do, over the longest baseline of both."""
    for ways in displacements:
        of_one, of_other = (ways[half][np.isfinite(ways[half, 0])] for half in (one, other))
        if min(len(of_one), len(of_other)) >= MIN_OLD:
            way = np.median(np.concatenate([of_one, of_other]), axis=0)
            step = np.median(of_one, axis=0) - np.median(of_other, axis=0)
            return bool(magnitude(step) > GROWS_SHARE * max(1.0, float(magnitude(way))))
    return False
