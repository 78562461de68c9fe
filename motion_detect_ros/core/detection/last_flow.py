"""The objects of the last flow, where flow is not measured in every frame (``optical_flow.every_s``)."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from motion_detect_ros.core.detection.candidate import Candidate
from motion_detect_ros.core.geometry.carried import Rows, carried, length_scale
from motion_detect_ros.core.geometry.vectors import pair
from motion_detect_ros.core.periods import exceeded
from motion_detect_ros.core.types import EgoMotion

#: Objects of the last flow move on for so many times the interval, as its next one may be lost on the way.
INTERVALS = 2.0


class LastFlow:
    """Carries candidates on with the ego-motion and their own velocity until the next flow comes."""

    def __init__(self, every_s: float) -> None:
        """every_s: flow is due so often, seconds; 0 = in every frame."""
        self._every_s = every_s
        self.reset()

    def reset(self) -> None:
        """Clear the candidates."""
        self._candidates, self._fresh = list[Candidate](), False
        self.age_s = 0.0

    def replaced(self, candidates: list[Candidate]) -> list[Candidate]:
        """Those of a new flow, returned as they are."""
        self._candidates, self._fresh, self.age_s = candidates, False, 0.0
        return candidates

    def replaced_late(self, candidates: list[Candidate]) -> None:
        """Those of the flow of the last frame, which nobody has been told of: measured, where they are carried to."""
        self.replaced(candidates)
        self._fresh = True

    @property
    def empty(self) -> bool:
        """Whether there is nothing to go on with."""
        return not self._candidates

    def carried(self, ego: EgoMotion) -> list[Candidate]:
        """Where they are in a frame without flow; none where a flow must have come. ego: motion into the frame.

        ``age_s`` counts in any case: call once for each frame, with or without flow.
        """
        self.age_s += ego.dt_s
        if exceeded(self.age_s, INTERVALS * self._every_s, ego.dt_s) or not ego.ok:
            self._candidates = []
        rows = ego.matrix.tolist()
        was, fresh = self._candidates, self._fresh
        moved = [_moved(each, rows, ego.dt_s) for each in was]
        self._candidates, self._fresh = moved, False
        if not fresh:
            return moved
        return [replace(each, growth=last.growth, measured=last.measured)
                for each, last in zip(moved, was, strict=True)]


def _moved(candidate: Candidate, rows: Rows, dt_s: float) -> Candidate:
    """Without what was measured in its own frame."""
    centre = pair(candidate.centre)
    place, velocity = carried(rows, centre, pair(candidate.velocity_px_s), dt_s)
    return Candidate(np.array(place), length_scale(rows, centre) * candidate.size, np.array(velocity), candidate.area,
                     candidate.log_odds, candidate.cluster, measured=False)
