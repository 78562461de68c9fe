"""Exponential forgetting with a time constant in seconds, independent of the frame rate."""

from __future__ import annotations

import math


def kept(dt_s: float, time_constant_s: float) -> float:
    """Weight 0 .. 1 of a value that is ``dt_s`` seconds old: exp(-dt_s / time_constant_s); time_constant_s: over 0."""
    return math.exp(-max(dt_s, 0.0) / time_constant_s)
