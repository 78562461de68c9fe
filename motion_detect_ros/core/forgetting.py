"""Exponential forgetting in seconds, so that every frame rate forgets alike."""

from __future__ import annotations

import math


def kept(dt_s: float, time_constant_s: float) -> float:
    """Share 0 .. 1 that is kept of what was known ``dt_s`` ago; time_constant_s: over 0, seconds."""
    return math.exp(-max(dt_s, 0.0) / time_constant_s)
