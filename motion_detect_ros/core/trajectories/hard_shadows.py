"""Hard shadows: in sunlight all objects of a scene have a dark side, on the same side of them.

A hard shadow is as dark as many a vehicle, so one object alone does not tell what of it is shadow; all objects of some
seconds together do: those that are brighter than the ground show how far their shadows reach beyond them. Under clouds
no side is the same for most vehicles of a street. What is dark on the same side of all of them for another reason, as
the trousers of people in light shirts, is taken for a shadow.
"""

from __future__ import annotations

import math
from collections.abc import Sequence

import cv2
import numpy as np

from motion_detect_ros.core.detection.recent_objects import RecentObjects
from motion_detect_ros.core.kernels import kernel
from motion_detect_ros.core.trajectories.soft_shadows import BRIGHT, DARK
from motion_detect_ros.core.types import BoolArray, ByteArray, DoubleArray, RecordArray

#: What is narrower than this is a rim of the object or of its shadow, pixels.
RIM = np.ones((5, 5), np.uint8)
#: A smaller share of bright pixels says nothing; rows and columns with less than this share of those of the fullest are
#: no part of what is bright.
LEAST_BRIGHT, LEAST_LINE = 0.2, 0.2
#: At least so many objects of one frame count.
LEAST_OBJECTS = 5
#: The share of objects whose dark side may reach less far; the most of a box that may be shadow.
EXCEPTIONS, MOST = 0.25, 1.0 / 3.0
#: A side of a box this close to the edge of the picture is where the picture ends, pixels.
EDGE_PX = 1.0


def dark_side(own: BoolArray, tones: ByteArray, left: int, top: int) -> DoubleArray | None:
    """(2,) how much further the dark reaches beyond what is brighter than the ground on the right than on the left, and
    at the bottom than at the top, shares of the width and the height of both; None where too little is brighter.

    own: (h, w) pixels of an object with its shadow, their outline at least, at left, top of the image; tones: of the
    image at half its size, ``SoftShadows.tones``.
    """
    places = cv2.findNonZero(own.view(np.uint8))
    if places is None:
        return None
    inside = cv2.fillConvexPoly(np.zeros(own.shape, np.uint8), cv2.convexHull(places), 1)
    bright, both = np.empty_like(inside), np.empty_like(inside)
    least = LEAST_BRIGHT * _fill_marked(inside, tones, left, top, bright, both)
    bright, both = (cv2.morphologyEx(marked, cv2.MORPH_OPEN, RIM) for marked in (bright, both))
    sides = np.empty(2)
    enough = _fill_sides(both, bright, least, np.empty(max(own.shape), np.int64), sides)
    return sides if enough else None


@kernel()
def _fill_marked(inside, tones, left, top, bright, both):  # type: ignore[no-untyped-def]
    """``bright``, ``both``: (h, w) 1 where a pixel inside is ``BRIGHT``, and where it is that or ``DARK``; returns the
    number of those inside.
    """
    count = 0
    for r in range(inside.shape[0]):
        for c in range(inside.shape[1]):
            tone = tones[(top + r) // 2, (left + c) // 2] if inside[r, c] else 0
            bright[r, c], both[r, c] = tone == BRIGHT, tone in (BRIGHT, DARK)
            count += inside[r, c]
    return count


@kernel(error_model='numpy')
def _fill_sides(both, bright, least, counts, sides):  # type: ignore[no-untyped-def]
    """``sides``: (2,) as ``dark_side``; returns False instead for less than ``least`` bright pixels, or none.

    both, bright: (h, w) 0 or 1; counts: scratch, (max(h, w),).
    """
    number = 0
    for r in range(bright.shape[0]):
        for c in range(bright.shape[1]):
            number += bright[r, c]
    if number < least or number == 0:
        return False
    for axis in range(2):
        first, last, most = len(counts), 0, 0
        for place in range(len(counts)):
            counts[place] = 0
        for r in range(both.shape[0]):
            for c in range(both.shape[1]):
                place = r if axis else c
                if both[r, c]:
                    first, last = min(first, place), max(last, place)
                counts[place] += bright[r, c]
                most = max(most, counts[place])
        begin, end = 0, len(counts) - 1
        while counts[begin] <= LEAST_LINE * most:
            begin += 1
        while counts[end] <= LEAST_LINE * most:
            end -= 1
        sides[axis] = (last - end - (begin - first)) / (last + 1 - first)
    return True


class SunSide:
    """The side of the objects of a scene on which their shadows are. ``share``: (2,) of their width and height that is
    in the dark beyond all but a few of them, negative on the left and at the top.
    """

    def __init__(self) -> None:
        self._recent = RecentObjects(LEAST_OBJECTS)
        self.reset()

    def reset(self) -> None:
        """Another scene."""
        self._recent.reset()
        self.share = np.zeros(2)

    def add(self, sides: Sequence[DoubleArray], stamp_ns: int) -> None:
        """Objects of one frame, as ``dark_side`` returns them, and its stamp."""
        self._recent.add(sides, stamp_ns)
        all_sides = self._recent.figures()
        self.share = np.zeros(2)
        if all_sides is not None:
            low, high = np.quantile(all_sides, (EXCEPTIONS, 1.0 - EXCEPTIONS), axis=0)
            self.share = np.clip(np.maximum(low, 0.0) + np.minimum(high, 0.0), -MOST, MOST)

    def without_shadows(self, records: RecordArray, width: int, height: int) -> RecordArray:
        """Reported objects of an image of ``width`` x ``height`` pixels, their boxes without that share, and as much
        less of their area; but none of it at the edge of the image, where the shadow may be outside.
        """
        axes = (('u', 'width', width), ('v', 'height', height))
        for share, (middle, side, size) in zip(self.share.tolist(), axes, strict=True):
            low, high = records[middle] - records[side] / 2.0, records[middle] + records[side] / 2.0
            inside = high < size - EDGE_PX if share > 0.0 else low > EDGE_PX
            less = np.where(inside, abs(share), 0.0)
            records[middle] -= math.copysign(1.0, share) * less * records[side] / 2.0
            records[side] *= 1.0 - less
            records['area'] *= 1.0 - less
        return records
