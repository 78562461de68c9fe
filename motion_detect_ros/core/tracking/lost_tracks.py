"""Tracks that were lost a short time ago: an object that is found again gets its id back."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np
from scipy.optimize import linear_sum_assignment

from motion_detect_ros.core.tracking.track import Track

#: For so long an object may be hidden, or stand still, until it is confirmed again, seconds.
KEPT_S = 1.0
#: It is looked for within this share of both sizes of its prediction, and this share of its way since then along it;
#: its area may differ by this factor's logarithm (e^1 = 2.7).
GATE_SHARE, WAY_SHARE, MAX_LOG_AREA_RATIO = 0.3, 0.5, 1.0
#: Cost of a pair outside of the gate.
FORBIDDEN = 1e6


@dataclass(frozen=True)
class _Lost:
    """``seconds``, ``frames``: since the last detection of ``track``; ``kept_s``: since its end."""

    track: Track
    seconds: float
    frames: int
    kept_s: float = 0.0


class LostTracks:
    """Confirmed tracks that ended in the image, carried on along their predictions for ``KEPT_S``."""

    def __init__(self) -> None:
        self._lost: list[_Lost] = []

    def reset(self) -> None:
        """Forget all."""
        self._lost.clear()

    def add(self, track: Track) -> None:
        """A track that has just ended."""
        self._lost.append(_Lost(track, track.coasted_s, track.coasted_frames))

    def carry(self, move: Callable[[Track], None], dt_s: float, width: int, height: int) -> None:
        """Over ``dt_s`` seconds by ``move``; those too old or outside of the width x height image are forgotten."""
        lost, self._lost = self._lost, []
        for each in lost:
            if each.kept_s + dt_s <= KEPT_S:
                move(each.track)
                if each.track.inside(width, height):
                    self._lost.append(replace(each, seconds=each.seconds + dt_s, frames=each.frames + 1,
                                              kept_s=each.kept_s + dt_s))

    def found_again(self, tracks: Sequence[Track]) -> list[Track | None]:
        """The lost one that each of the tracks just confirmed goes on, which is forgotten here; None: a new object.

        The pairs of least total cost (Kuhn 1955).
        """
        found: list[Track | None] = [None] * len(tracks)
        if not tracks or not self._lost:
            return found
        cost = np.array([[_cost(each, track) for track in tracks] for each in self._lost])
        pairs = [(row, column) for row, column in zip(*linear_sum_assignment(cost), strict=True)
                 if cost[row, column] < 1.0]
        for row, column in pairs:
            found[column] = self._lost[row].track
        rows = {row for row, _ in pairs}
        self._lost = [each for row, each in enumerate(self._lost) if row not in rows]
        return found


def _cost(lost: _Lost, found: Track) -> float:
    """Distance of the two in units of the gate; ``FORBIDDEN`` for what was seen beside the lost one, differs much in
    size, or in velocity by more than the faster one's speed.
    """
    track = lost.track
    speed = math.hypot(*track.velocity)
    if (found.age > lost.frames
            or math.dist(found.velocity, track.velocity) > max(speed, math.hypot(*found.velocity))
            or abs(math.log(math.prod(found.size) / math.prod(track.size))) >= MAX_LOG_AREA_RATIO):
        return FORBIDDEN
    x, y = (track.velocity[0] / speed, track.velocity[1] / speed) if speed else (1.0, 0.0)
    off_u, off_v = (found.centre[axis] - track.centre[axis] for axis in (0, 1))
    gate_u, gate_v = (GATE_SHARE * (found.size[axis] + track.size[axis]) for axis in (0, 1))
    along = (x * off_u + y * off_v) / (math.hypot(x * gate_u, y * gate_v) + WAY_SHARE * speed * lost.seconds)
    across = (x * off_v - y * off_u) / math.hypot(y * gate_u, x * gate_v)
    cost = math.hypot(along, across)
    return cost if cost < 1.0 else FORBIDDEN
