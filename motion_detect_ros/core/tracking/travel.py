"""How far an object has gone over the ground: evidence that only a whole track holds.

What noise, haze or the tracker's errors make seem to move in one frame goes nowhere over a second; a small object that
is hardly believed in any one frame does.
"""

from __future__ import annotations

import numpy as np

from motion_detect_ros.core.geometry.carried import carried
from motion_detect_ros.core.types import DoubleArray

#: A track is believed by so much more, log odds, once it has gone its own size and lives for so long, seconds.
TRAVELLED_LOG_ODDS, TRAVELLED_SIZES, TRAVELLED_S = 3.0, 1.0, 1.0
#: Not within this distance of a larger object, sizes of that one: its shadow or a part goes with it.
BESIDE_SIZES = 1.0

_AT_REST = np.zeros(2)


class Travel:
    """The place over the ground where a track began, carried on with the camera's motion."""

    def __init__(self, centre: DoubleArray) -> None:
        """centre: (2,) full-resolution pixels."""
        self._start, self._seconds = centre, 0.0

    def predict(self, matrix: DoubleArray, dt_s: float) -> None:
        """matrix: (3, 3) previous pixel -> current pixel; dt_s: seconds."""
        self._start, _ = carried(matrix, self._start, _AT_REST, dt_s)
        self._seconds += dt_s

    def log_odds(self, centre: DoubleArray, size: DoubleArray) -> float:
        """What the way adds for an object that is now at ``centre``, (2,), of ``size``, (2,), pixels."""
        way = float(np.hypot(*(centre - self._start)))
        far = self._seconds >= TRAVELLED_S and way >= TRAVELLED_SIZES * float(np.sqrt(size.prod()))
        return TRAVELLED_LOG_ODDS if far else 0.0


class Others:
    """Boxes that a small one may be a part or the shadow of."""

    def __init__(self, centres: list[DoubleArray], sizes: list[DoubleArray]) -> None:
        """centres, sizes: (2,) each, pixels."""
        self._centres, sizes_px = np.reshape(centres, (-1, 2)), np.reshape(sizes, (-1, 2))
        self._areas = sizes_px.prod(axis=1)
        self._reach = sizes_px / 2.0 + BESIDE_SIZES * np.sqrt(self._areas)[:, None]

    def holds_larger(self, centre: DoubleArray, size: DoubleArray) -> bool:
        """Whether a box is in or near one of larger area; it may be one of them itself. centre, size: (2,) pixels."""
        near = (np.abs(centre - self._centres) < self._reach).all(axis=1)
        return bool((near & (self._areas > size.prod())).any())
