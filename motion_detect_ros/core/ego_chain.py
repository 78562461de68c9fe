"""The last few ego-motions, chained, so that stages can look back over more than one frame.

Every stage that looks back derives the same earlier frame from the same ``ego_motion`` messages, so the nodes
agree without telling each other.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from motion_detect_ros.core.types import NANOSECONDS, DoubleArray, EgoMotion

#: Longest look back, frames.
MAX_LINKS = 16


@dataclass(frozen=True)
class LookBack:
    """An earlier frame: its stamp, ``matrix`` (3, 3) earlier pixel -> current pixel, and how many frames back."""

    stamp_ns: int
    matrix: DoubleArray
    frames: int


class EgoChain:
    """Composes consecutive ego-motions; broken (emptied) where one of them is missing or not OK."""

    def __init__(self) -> None:
        self._links: list[EgoMotion] = []

    def reset(self) -> None:
        """Forget all links."""
        self._links.clear()

    def append(self, ego: EgoMotion) -> None:
        """Add the motion into the newest frame. A gap against the newest link empties the chain first."""
        follows = bool(self._links) and ego.prev_stamp_ns == self._links[-1].stamp_ns
        if not ego.ok or not follows:
            self._links.clear()
        if ego.ok:
            self._links.append(ego)
            del self._links[:-MAX_LINKS]

    def look_back(self, seconds: float) -> LookBack | None:
        """The earlier frame whose distance in time is closest to ``seconds``; None where the chain is empty."""
        choices = list(self.look_backs())
        if not choices:
            return None
        newest = self._links[-1].stamp_ns
        return min(choices, key=lambda back: abs((newest - back.stamp_ns) / NANOSECONDS - seconds))

    def look_backs(self) -> list[LookBack]:
        """All earlier frames that the chain reaches, nearest first."""
        found, matrix = [], np.eye(3)
        for frames, link in enumerate(reversed(self._links), start=1):
            matrix = matrix @ link.matrix
            found.append(LookBack(link.prev_stamp_ns, matrix, frames))
        return found
