"""One object seen in one frame: what detection hands to tracking."""

from __future__ import annotations

from dataclasses import dataclass

from motion_detect_ros.core.types import DoubleArray


@dataclass(frozen=True)
class Growth:
    """How fast one candidate grows in the picture.

    ``rate``: closing speed over distance, 1/s, at the time of the frame; ``variance``: of it; ``seconds``: between the
    two pictures it was measured in; ``log_size``: logarithm of the box's size, NaN where the picture's border cuts it.
    """

    rate: float
    variance: float
    seconds: float
    log_size: float


@dataclass(frozen=True)
class Candidate:
    """One object seen in one frame. ``centre``, ``size``, ``velocity_px_s``: (2,) full-resolution pixels.

    ``log_odds``: how sure this frame alone is that it moves, see ``scoring``; ``growth``: None = not measured.
    """

    centre: DoubleArray
    size: DoubleArray
    velocity_px_s: DoubleArray
    area: float
    log_odds: float
    cluster: int
    growth: Growth | None = None
