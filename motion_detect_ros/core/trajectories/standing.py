"""Where points say that nothing moves: what flow takes for an object there is parallax or noise."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import numpy.typing as npt

from motion_detect_ros.core.detection.candidate import Candidate
from motion_detect_ros.core.geometry.order_statistics import median
from motion_detect_ros.core.geometry.vectors import magnitude
from motion_detect_ros.core.kernels import kernel
from motion_detect_ros.core.trajectories.object_motion import PointMotion
from motion_detect_ros.core.trajectories.points import Points

#: Nothing moves in a box if points that would tell the motion claimed for it lie in so many of its nine parts, less
#: than this share of them move, and the median of their evidence is lower than this, noise units.
SIDE, PARTS, MOVING_SHARE, STANDING_SIGMAS = 3, 6, 0.1, 1.5
#: What it tells that points do not deny a candidate: all right ones are left then, and 292 of 604 false ones, on a
#: clip that nothing was chosen on; the logarithm of the ratio.
NOT_DENIED_LOG_ODDS = 0.7


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
        if not candidates:
            return []
        then, there = now.survivors(self._points, self._old)
        centre, size = np.array([each.centre for each in candidates]), np.array([each.size for each in candidates])
        speed = scale * magnitude(np.array([each.velocity_px_s for each in candidates]))
        still = np.empty(len(candidates), np.bool_)
        _stand_still(now.now[there], self._motion.least_speed[then], self._motion.moving[then],
                     self._motion.evidence[then], centre, size, speed, scale, np.empty(len(then)), still)
        return list(still.tolist())


@kernel()
def _stand_still(  # type: ignore[no-untyped-def]
    places, least_speed, moving, evidence, centre, size, speed, scale, scratch, still,
):
    """Of points (N,) in boxes (K,), pixels before scaling. scratch: (N,)."""
    for box in range(len(centre)):
        x, y = centre[box]
        width, height = size[box]
        left, right = scale * (x - width / 2.0), scale * (x + width / 2.0)
        top, bottom = scale * (y - height / 2.0), scale * (y + height / 2.0)
        telling = moved = parts = 0
        for point in range(len(places)):
            u, v = places[point]
            if left <= u < right and top <= v < bottom and least_speed[point] < speed[box]:
                column = min(int(SIDE * ((u / scale - x) / width + 0.5)), SIDE - 1)
                row = min(int(SIDE * ((v / scale - y) / height + 0.5)), SIDE - 1)
                parts |= 1 << SIDE * row + column
                moved += moving[point]
                scratch[telling] = evidence[point]
                telling += 1
        filled = 0
        while parts:
            filled, parts = filled + (parts & 1), parts >> 1
        still[box] = (filled >= PARTS and moved < MOVING_SHARE * telling
                      and median(scratch[:telling]) < STANDING_SIGMAS)
