"""Where an object goes from one frame to the next: ego-motion of its place, then its own velocity."""

from __future__ import annotations

import math

from motion_detect_ros.core.geometry.bearings import PIXEL_CENTRE
from motion_detect_ros.core.geometry.vectors import Pair

#: The rows of a (3, 3) warp as plain numbers: ``matrix.tolist()``, once for all objects.
Rows = list[list[float]]


def carried(rows: Rows, centre: Pair, velocity: Pair, dt_s: float) -> tuple[Pair, Pair]:
    """Centre and velocity after ``dt_s`` seconds.

    rows: of the warp previous pixel -> current pixel; centre: of a box, pixels, in edges of pixels (warps are in
    centres); velocity: against the background, pixels/s.
    """
    (u, v), (a, b), (d, e) = _linear(rows, centre)
    vx, vy = a * velocity[0] + b * velocity[1], d * velocity[0] + e * velocity[1]
    return (u + PIXEL_CENTRE + vx * dt_s, v + PIXEL_CENTRE + vy * dt_s), (vx, vy)


def length_scale(rows: Rows, centre: Pair) -> float:
    """By how much lengths grow under a warp at a place, pixels, in edges of pixels."""
    _, (a, b), (d, e) = _linear(rows, centre)
    return math.sqrt(abs(a * e - b * d))


def _linear(rows: Rows, centre: Pair) -> tuple[Pair, Pair, Pair]:
    """Where a warp takes a place, in centres of pixels, and the rows of its derivative there, which is the same
    everywhere but under a perspective.
    """
    (a, b, c), (d, e, f), (g, h, i) = rows
    x, y = centre[0] - PIXEL_CENTRE, centre[1] - PIXEL_CENTRE
    depth = g * x + h * y + i
    u, v = (a * x + b * y + c) / depth, (d * x + e * y + f) / depth
    return (u, v), ((a - u * g) / depth, (b - u * h) / depth), ((d - v * g) / depth, (e - v * h) / depth)
