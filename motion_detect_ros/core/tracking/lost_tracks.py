"""Tracks that were lost a short time ago: an object that is found again gets its id back."""

from __future__ import annotations

import math
from collections.abc import Callable

from motion_detect_ros.core.tracking.track import Track

#: For so long an object may be hidden, or stand still, seconds.
KEPT_S = 1.0
#: It is looked for within this share of both sizes of its prediction, and this share of its way since then; its area
#: may differ by this factor's logarithm (e^1 = 2.7).
GATE_SHARE, WAY_SHARE, MAX_LOG_AREA_RATIO = 0.3, 0.5, 1.0


class LostTracks:
    """Confirmed tracks that ended in the image, carried on along their predictions for ``KEPT_S``."""

    def __init__(self) -> None:
        self._lost: list[tuple[Track, float]] = []  # with the time since their end, seconds

    def reset(self) -> None:
        """Forget all."""
        self._lost.clear()

    def add(self, track: Track) -> None:
        """A track that has just ended."""
        self._lost.append((track, 0.0))

    def carry(self, move: Callable[[Track], None], dt_s: float, width: int, height: int) -> None:
        """Over ``dt_s`` seconds by ``move``; those too old or outside of the width x height image are forgotten."""
        kept = []
        for track, lost_s in self._lost:
            if lost_s + dt_s <= KEPT_S:
                move(track)
                if track.inside(width, height):
                    kept.append((track, lost_s + dt_s))
        self._lost = kept

    def found_again(self, track: Track) -> Track | None:
        """The lost one that a track just confirmed goes on, which is forgotten here; None where it is a new object."""
        costs = [_cost(lost, lost_s, track) for lost, lost_s in self._lost]
        best = min(range(len(costs)), key=costs.__getitem__, default=None)
        if best is None or costs[best] >= 1.0:
            return None
        return self._lost.pop(best)[0]


def _cost(lost: Track, lost_s: float, found: Track) -> float:
    """Distance of the two in units of the gate; infinite where the sizes differ too much."""
    if abs(math.log(math.prod(found.size) / math.prod(lost.size))) >= MAX_LOG_AREA_RATIO:
        return math.inf
    way = WAY_SHARE * math.hypot(*lost.velocity) * (lost.coasted_s + lost_s)
    offs = [(found.centre[axis] - lost.centre[axis]) / (GATE_SHARE * (found.size[axis] + lost.size[axis]) + way)
            for axis in (0, 1)]
    return math.hypot(*offs)
