"""Where points say that nothing moves: what flow takes for an object there is parallax or noise."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import numpy.typing as npt

from motion_detect_ros.core.detection.candidate import Candidate
from motion_detect_ros.core.trajectories.object_motion import PointMotion
from motion_detect_ros.core.trajectories.points import Points
from motion_detect_ros.core.types import BoolArray, FloatArray

#: Nothing moves in a box if points that would tell the motion claimed for it lie in so many of its nine parts, less
#: than this share of them move, and the median of their evidence is lower than this, noise units.
SIDE, PARTS, MOVING_SHARE, STANDING_SIGMAS = 3, 6, 0.1, 1.5


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
        places, least_speed = now.now[there], self._motion.least_speed[then]
        moving, evidence = self._motion.moving[then], self._motion.evidence[then]
        found = []
        for each in candidates:
            part = _part(places, each, scale)
            telling = (part >= 0) & (least_speed < scale * np.hypot(*each.velocity_px_s))
            found.append(bool(
                len(np.unique(part[telling])) >= PARTS and moving[telling].mean() < MOVING_SHARE
                and np.median(evidence[telling]) < STANDING_SIGMAS))
        return found


def _part(places: FloatArray, candidate: Candidate, scale: float) -> npt.NDArray[np.intp]:
    """(N,) in which of the nine parts of a box each place (N, 2) is; -1 outside."""
    share = (places - scale * (candidate.centre - candidate.size / 2.0)) / (scale * candidate.size)
    inside: BoolArray = np.all((share >= 0.0) & (share < 1.0), axis=1)
    column, row = (SIDE * share).astype(np.intp).T
    return np.where(inside, SIDE * row + column, -1)
