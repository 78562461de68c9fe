"""What holds several objects: neighbours that drive alike and touch in the picture, by their shadows too.

Nothing between two such objects tells them apart; that a scene's objects are of a size does. What is larger than
nearly all of them, and fills its box worse than its two halves fill theirs, is two.
"""

from __future__ import annotations

import math
from collections.abc import Sequence

import cv2
import numpy as np
import numpy.typing as npt

from motion_detect_ros.core.detection.recent_objects import RecentObjects
from motion_detect_ros.core.types import BoolArray, FloatArray

#: The usual size is one that this share of the objects does not exceed: cars are usual among motorcycles, too.
USUAL_SHARE = 0.75
#: What holds several objects is larger than the usual size by this factor of the area, and the boxes of its halves have
#: at most this share of its own together.
LARGER, HALVES_SHARE = 1.6, 0.9
#: Halves whose places are further apart than this share of the usual size's side are the ends of one plain body:
#: neighbours that are seen as one nearly touch.
GAP_SHARE = 0.3
#: Directions across the cuts that are tried: columns, rows and diagonals of the picture.
ACROSS_CUTS = np.array([[1.0, 0.0], [0.0, 1.0], [1.0, 1.0], [1.0, -1.0]], np.float32)


class UsualSize:
    """``area``: which most objects of the last seconds do not exceed, pixels of the working resolution; None as long as
    too few were seen together.
    """

    def __init__(self, least_objects: int) -> None:
        """least_objects: so many of one frame count."""
        self._recent = RecentObjects(least_objects)
        self.reset()

    def reset(self) -> None:
        """Another scene."""
        self._recent.reset()
        self.area: float | None = None

    def add(self, areas: Sequence[float], stamp_ns: int) -> None:
        """Those of the objects of one frame, as ``halves`` measures them, and its stamp."""
        self._recent.add(areas, stamp_ns)
        all_areas = self._recent.figures()
        self.area = None if all_areas is None else float(np.quantile(all_areas, USUAL_SHARE))


def halves(places: FloatArray, usual_area: float, least: int, reach_px: float) -> BoolArray | None:
    """(n,) which of the places of something belong to the first of the two objects that it is; None where it is one.

    It is cut along a column, a row or a diagonal of the picture, where the boxes of both halves are smallest; a long
    one that lies across them fills a rectangle of another direction, a plain one shows its ends. places: (n, 2) pixels;
    usual_area: of ``UsualSize``; least: fewest places of an object; reach_px: how far around a place the object is.
    """
    if len(places) < 2 * least:
        return None
    area = box_area(places.min(axis=0), places.max(axis=0), reach_px)
    if area < LARGER * usual_area:
        return None
    first, of_halves = _cut(places, least, reach_px)
    if of_halves > HALVES_SHARE * area or _gap(places[first], places[~first]) > GAP_SHARE * math.sqrt(usual_area):
        return None
    whole, *parts = (_turned_area(each, reach_px) for each in (places, places[first], places[~first]))
    return None if sum(parts) > whole else first


def box_area(low: FloatArray, high: FloatArray, reach_px: float) -> float:
    """Of what reaches beyond places with these bounds, (2,) pixels."""
    return float((high - low + 2.0 * reach_px).prod())


def _cut(places: FloatArray, least: int, reach_px: float) -> tuple[BoolArray, float]:
    """(n,) which places belong to the first of two halves of ``least`` at least, and the area of the halves' boxes."""
    found = list[tuple[float, npt.NDArray[np.intp]]]()
    for along in ACROSS_CUTS:
        order = np.argsort(places @ along, kind='stable')
        in_order = places[order]
        before = _areas_up_to(in_order, reach_px)[least - 1:len(places) - least]
        after = _areas_up_to(in_order[::-1], reach_px)[::-1][least:len(places) - least + 1]
        best = int(np.argmin(before + after))
        found.append((float(before[best] + after[best]), order[:least + best]))
    area, half = min(found, key=lambda each: each[0])
    first = np.zeros(len(places), np.bool_)
    first[half] = True
    return first, area


def _gap(one: FloatArray, other: FloatArray) -> float:
    """Width of the empty columns or rows between the boxes of places, (n, 2) each; negative where there are none."""
    return float(np.maximum(other.min(axis=0) - one.max(axis=0), one.min(axis=0) - other.max(axis=0)).max())


def _areas_up_to(places: FloatArray, reach_px: float) -> FloatArray:
    """(n,) area of the box of the first 1, 2, ... n places."""
    sides = np.maximum.accumulate(places) - np.minimum.accumulate(places) + 2.0 * reach_px
    area: FloatArray = sides.prod(axis=1)
    return area


def _turned_area(places: FloatArray, reach_px: float) -> float:
    """Area of the smallest rectangle of any direction."""
    _, (width, height), _ = cv2.minAreaRect(places)
    return float((width + 2.0 * reach_px) * (height + 2.0 * reach_px))
