"""Fields of two-component vectors."""

from __future__ import annotations

import numpy as np

from motion_detect_ros.core.types import FloatArray


def magnitude(flow: FloatArray) -> FloatArray:
    """(gh, gw) length of (gh, gw, 2) vectors, in their unit."""
    length: FloatArray = np.hypot(flow[..., 0], flow[..., 1])
    return length
