"""Where an object goes from one frame to the next: ego-motion of its place, then its own velocity."""

from __future__ import annotations

import math

import numpy as np

from motion_detect_ros.core.geometry.bearings import PIXEL_CENTRE
from motion_detect_ros.core.types import DoubleArray


def carried(
    matrix: DoubleArray, centre: DoubleArray, velocity: DoubleArray, dt_s: float,
) -> tuple[DoubleArray, DoubleArray]:
    """Centre and velocity after ``dt_s`` seconds.

    matrix: (3, 3) previous pixel -> current pixel; centre: (2,) of a box, pixels, in edges of pixels (warps are in
    centres); velocity: (2,) against the background, pixels/s.
    """
    (a, b, c), (d, e, f), (g, h, i) = matrix.tolist()
    x, y = float(centre[0]) - PIXEL_CENTRE, float(centre[1]) - PIXEL_CENTRE
    vx, vy = float(velocity[0]), float(velocity[1])
    depth = g * x + h * y + i
    vx, vy = a * vx + b * vy, d * vx + e * vy
    return (np.array([(a * x + b * y + c) / depth + PIXEL_CENTRE + vx * dt_s,
                      (d * x + e * y + f) / depth + PIXEL_CENTRE + vy * dt_s]), np.array([vx, vy]))


def length_scale(matrix: DoubleArray) -> float:
    """By how much lengths grow under a (3, 3) warp, from its linear part."""
    (a, b, _), (d, e, _), _ = matrix.tolist()
    return math.sqrt(abs(a * e - b * d))
