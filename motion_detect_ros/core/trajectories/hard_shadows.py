"""Hard shadows: in sunlight all objects of a scene have a dark side, on the same side of them.

A hard shadow is as dark as many a vehicle, so one object alone does not tell what of it is shadow; all objects of some
seconds together do: those that are brighter than the ground show how far their shadows reach beyond them. Where the sky
is overcast no side is the same for most.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Sequence
from dataclasses import replace

import cv2
import numpy as np

from motion_detect_ros.core.detection.candidate import Candidate
from motion_detect_ros.core.trajectories.soft_shadows import BRIGHTEST, DARKEST
from motion_detect_ros.core.types import BoolArray, DoubleArray, FloatArray

#: What is narrower than this is a rim of the object or of its shadow, pixels.
RIM = np.ones((5, 5), np.uint8)
#: A smaller share of bright pixels says nothing; rows and columns with less than this share of those of the fullest are
#: no part of what is bright.
LEAST_BRIGHT, LEAST_LINE = 0.2, 0.2
#: So long objects are remembered, seconds; so many different ones are a scene.
MEMORY_S, LEAST_OBJECTS = 2.0, 5
#: The share of objects whose dark side may reach less far.
EXCEPTIONS = 0.25


def dark_side(own: BoolArray, ratio: FloatArray) -> DoubleArray | None:
    """(2,) how much further the dark reaches beyond what is brighter than the ground on the right than on the left, and
    at the bottom than at the top, shares of the width and the height of both; None where too little is brighter.

    own: (h, w) pixels of an object with its shadow, their outline at least; ratio: (h, w) grey values to those of the
    ground that was there.
    """
    if not own.any():
        return None
    outline = cv2.convexHull(np.argwhere(own)[:, ::-1].astype(np.int32))
    inside = cv2.fillConvexPoly(np.zeros(own.shape, np.uint8), outline, 1)
    bright, both = (cv2.morphologyEx(inside * pixels, cv2.MORPH_OPEN, RIM)
                    for pixels in (ratio > BRIGHTEST, (ratio > BRIGHTEST) | (ratio < DARKEST)))
    if np.count_nonzero(bright) < LEAST_BRIGHT * np.count_nonzero(inside):
        return None
    sides = []
    for axis in (0, 1):
        whole, counts = np.flatnonzero(both.any(axis=axis)), bright.sum(axis=axis)
        body = np.flatnonzero(counts > LEAST_LINE * counts.max())
        sides.append((whole[-1] - body[-1] - (body[0] - whole[0])) / (whole[-1] + 1 - whole[0]))
    return np.array(sides)


class SunSide:
    """The side of the objects of a scene on which their shadows are. ``share``: (2,) of their width and height that is
    in the dark beyond all but a few of them, negative on the left and at the top.
    """

    def __init__(self) -> None:
        self.reset()

    def reset(self) -> None:
        """Another scene."""
        self._seen = deque[tuple[float, DoubleArray]]()
        self._now_s = 0.0
        self.share = np.zeros(2)

    def after(self, dt_s: float) -> None:
        """dt_s: since the last frame, seconds."""
        self._now_s += dt_s

    def add(self, sides: Sequence[DoubleArray]) -> None:
        """Objects of one frame, as ``dark_side`` returns them."""
        if sides:
            self._seen.append((self._now_s, np.array(sides)))
        while self._seen and self._seen[0][0] < self._now_s - MEMORY_S:
            self._seen.popleft()
        self.share = np.zeros(2)
        if max((len(each) for _, each in self._seen), default=0) >= LEAST_OBJECTS:
            sides = np.concatenate([each for _, each in self._seen])
            low, high = np.quantile(sides, (EXCEPTIONS, 1.0 - EXCEPTIONS), axis=0)
            self.share = np.maximum(low, 0.0) + np.minimum(high, 0.0)

    def without_shadows(self, candidates: list[Candidate]) -> list[Candidate]:
        """Their boxes without that share."""
        if not self.share.any():
            return candidates
        return [replace(each, centre=each.centre - self.share * each.size / 2.0,
                        size=each.size * (1.0 - np.abs(self.share))) for each in candidates]
