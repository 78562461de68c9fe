"""How far an object has gone over the ground: evidence that only a whole track holds.

What noise, haze or the tracker's errors make seem to move in one frame goes nowhere over a second; a small object that
is hardly believed in any one frame does.
"""

from __future__ import annotations

import math

import numpy as np

from motion_detect_ros.core.geometry.carried import Rows, carried
from motion_detect_ros.core.geometry.vectors import Pair
from motion_detect_ros.core.types import BoolArray

#: A track is believed by so much more, log odds, once it has gone its own size and lives for so long, seconds.
TRAVELLED_LOG_ODDS, TRAVELLED_SIZES, TRAVELLED_S = 3.0, 1.0, 1.0
#: Not within this distance of a larger object, sizes of that one: its shadow or a part goes with it.
BESIDE_SIZES = 1.0

_AT_REST = (0.0, 0.0)


class Travel:
    """The place over the ground where a track began, carried on with the camera's motion."""

    def __init__(self, centre: Pair) -> None:
        """centre: full-resolution pixels."""
        self._start, self._seconds = centre, 0.0

    def predict(self, rows: Rows, dt_s: float) -> None:
        """rows: of the warp previous pixel -> current pixel; dt_s: seconds."""
        self._start, _ = carried(rows, self._start, _AT_REST, dt_s)
        self._seconds += dt_s

    def jump(self, way: Pair) -> None:
        """The picture turns out to have gone so far, pixels, beyond what was told before."""
        self._start = self._start[0] + way[0], self._start[1] + way[1]

    def log_odds(self, centre: Pair, size: Pair) -> float:
        """What the way adds for an object that is now at ``centre``, of ``size``, pixels."""
        if self._seconds < TRAVELLED_S:
            return 0.0
        way = math.hypot(centre[0] - self._start[0], centre[1] - self._start[1])
        return TRAVELLED_LOG_ODDS if way >= TRAVELLED_SIZES * math.sqrt(size[0] * size[1]) else 0.0


class Others:
    """Boxes that a small one may be a part or the shadow of."""

    def __init__(self, centres: list[Pair], sizes: list[Pair]) -> None:
        """centres, sizes: pixels."""
        self._centres, sizes_px = np.reshape(centres, (-1, 2)), np.reshape(sizes, (-1, 2))
        self._areas = sizes_px.prod(axis=1)
        self._reach = sizes_px / 2.0 + BESIDE_SIZES * np.sqrt(self._areas)[:, None]

    def hold_larger(self, centres: list[Pair], sizes: list[Pair]) -> BoolArray:
        """(n,) whether each box is in or near one of larger area; it may be one of them itself. Pixels."""
        ones, areas = np.reshape(centres, (-1, 2)), np.reshape(sizes, (-1, 2)).prod(axis=1)
        near = (np.abs(ones[:, None] - self._centres) < self._reach).all(axis=2)
        held: BoolArray = (near & (self._areas > areas[:, None])).any(axis=1)
        return held
