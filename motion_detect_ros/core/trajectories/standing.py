"""Where points say that nothing moves: what flow takes for an object there is parallax or noise."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import numpy.typing as npt

from motion_detect_ros.core.detection.candidate import Candidate
from motion_detect_ros.core.trajectories.object_motion import PointMotion
from motion_detect_ros.core.trajectories.points import Points
from motion_detect_ros.core.types import FloatArray

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
        places = np.ascontiguousarray(now.now[there].T)
        least_speed = self._motion.least_speed[then]
        moving, evidence = self._motion.moving[then], self._motion.evidence[then]
        found = []
        for each in candidates:
            inside = _inside(places, each, scale)
            telling = inside[least_speed[inside] < scale * np.hypot(*each.velocity_px_s)]
            found.append(bool(
                _parts(places[:, telling], each, scale) >= PARTS and moving[telling].mean() < MOVING_SHARE
                and np.median(evidence[telling]) < STANDING_SIGMAS))
        return found


def _inside(places: FloatArray, candidate: Candidate, scale: float) -> npt.NDArray[np.intp]:
    """Indices of the places, (2, N), in a box."""
    x, y = places
    left, top = scale * (candidate.centre - candidate.size / 2.0)
    right, bottom = scale * (candidate.centre + candidate.size / 2.0)
    return np.flatnonzero((x >= left) & (x < right) & (y >= top) & (y < bottom))


def _parts(places: FloatArray, candidate: Candidate, scale: float) -> int:
    """In how many of its nine parts the places, (2, n), in a box are."""
    share = (places.T / scale - candidate.centre) / candidate.size + 0.5
    column, row = np.clip(SIDE * share, 0, SIDE - 1).astype(np.intp).T
    return len(set((SIDE * row + column).tolist()))
