"""Where points say that nothing moves: what flow takes for an object there is parallax or noise."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import numpy.typing as npt

from motion_detect_ros.core.detection.candidate import Candidate
from motion_detect_ros.core.trajectories.object_motion import PointMotion
from motion_detect_ros.core.trajectories.points import Points
from motion_detect_ros.core.types import BoolArray, FloatArray

#: Nothing moves in a box with so many points that would tell the motion claimed for it, of which less than this share
#: move, and the median of whose evidence is lower than this, noise units.
MIN_POINTS, MOVING_SHARE, STANDING_SIGMAS = 5, 0.1, 1.5


class StandingPoints:
    """The points of the frame in which motion was last measured, and what it said of each."""

    def __init__(self) -> None:
        self._points, self._motion, self._old = Points(), PointMotion.at_rest(0), np.zeros(0, np.intp)

    def measured(self, points: Points, motion: PointMotion, old: npt.NDArray[np.intp]) -> None:
        """Another motion; old: indices of the points that are old enough to tell."""
        self._points, self._motion, self._old = points, motion, old

    def denied(self, candidates: Sequence[Candidate], now: Points, scale: float) -> list[bool]:
        """For each of the candidates of a frame, whether the points in its box stand still.

        now: the points of that frame; scale: working pixels per full-resolution pixel.
        """
        then, there = now.survivors(self._points, self._old)
        places, moving, evidence = now.now[there], self._motion.moving[then], self._motion.evidence[then]
        least_speed = self._motion.least_speed[then]
        found = []
        for each in candidates:
            speed = scale * np.hypot(*each.velocity_px_s)
            telling = _inside(places, each, scale) & (least_speed < speed)
            found.append(bool(
                np.count_nonzero(telling) >= MIN_POINTS and moving[telling].mean() < MOVING_SHARE
                and np.median(evidence[telling]) < STANDING_SIGMAS))
        return found


def _inside(places: FloatArray, candidate: Candidate, scale: float) -> BoolArray:
    offset = np.abs(places - scale * candidate.centre)
    inside: BoolArray = np.all(offset <= scale * candidate.size / 2.0, axis=1)
    return inside
