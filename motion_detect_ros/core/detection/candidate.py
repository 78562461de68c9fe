"""One detected object in one frame: the input of tracking."""

from __future__ import annotations

from dataclasses import dataclass

from motion_detect_ros.core.types import DoubleArray


@dataclass(frozen=True)
class Growth:
    """Rate of expansion of one candidate in the image.

    ``rate``: closing speed over distance, 1/s, at the time of the frame; ``variance``: of it; ``seconds``: time
    between the two frames; ``log_size``: logarithm of the box's size, NaN where the image border cuts it.
    """

    rate: float
    variance: float
    seconds: float
    log_size: float


@dataclass(frozen=True)
class Candidate:
    """One detected object in one frame. ``centre``, ``size``, ``velocity_px_s``: (2,) full-resolution pixels.

    ``log_odds``: that it moves, from this frame alone, see ``scoring``; ``growth``: None = not measured; ``measured``:
    False where it is one of an earlier frame, carried on.
    """

    centre: DoubleArray
    size: DoubleArray
    velocity_px_s: DoubleArray
    area: float
    log_odds: float
    cluster: int
    growth: Growth | None = None
    measured: bool = True
