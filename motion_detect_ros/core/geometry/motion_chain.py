"""The last ego-motions, composed: the motion over more than one frame."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from motion_detect_ros.core.types import NANOSECONDS, DoubleArray, EgoMotion

#: Longest chain, frames.
MAX_LINKS = 16


@dataclass(frozen=True)
class ChainedMotion:
    """``matrix``: (3, 3) pixel of the frame of ``stamp_ns`` -> current pixel."""

    stamp_ns: int
    matrix: DoubleArray


class MotionChain:
    """Composes consecutive ego-motions; broken (emptied) where one of them is missing or not OK."""

    def __init__(self) -> None:
        self._links: list[EgoMotion] = []

    def reset(self) -> None:
        """Clear all links."""
        self._links.clear()

    def append(self, ego: EgoMotion) -> None:
        """Add the motion into the newest frame. A gap against the newest link empties the chain first."""
        follows = bool(self._links) and ego.prev_stamp_ns == self._links[-1].stamp_ns
        if not ego.ok or not follows:
            self._links.clear()
        if ego.ok:
            self._links.append(ego)
            del self._links[:-MAX_LINKS]

    def nearest(self, seconds: float) -> ChainedMotion | None:
        """The motion from the earlier frame that is closest to ``seconds`` ago; None where the chain is empty."""
        choices = self.chained()
        if not choices:
            return None
        newest = self._links[-1].stamp_ns
        return min(choices, key=lambda motion: abs((newest - motion.stamp_ns) / NANOSECONDS - seconds))

    def chained(self) -> list[ChainedMotion]:
        """The motion from every earlier frame of the chain, latest frame first."""
        found, matrix = [], np.eye(3)
        for link in reversed(self._links):
            matrix = matrix @ link.matrix
            found.append(ChainedMotion(link.prev_stamp_ns, matrix))
        return found
