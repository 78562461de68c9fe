"""Where an object goes from one frame to the next: ego-motion of its place, then its own velocity."""

from __future__ import annotations

import numpy as np

from motion_detect_ros.core.geometry.bearings import PIXEL_CENTRE
from motion_detect_ros.core.types import DoubleArray


def carried(
    matrix: DoubleArray, centre: DoubleArray, velocity: DoubleArray, dt_s: float,
) -> tuple[DoubleArray, DoubleArray, float]:
    """Centre, velocity and relative size after ``dt_s`` seconds.

    matrix: (3, 3) previous pixel -> current pixel; centre: (2,) of a box, pixels, in edges of pixels (warps are in
    centres); velocity: (2,) against the background, pixels/s.
    """
    moved = matrix @ [centre[0] - PIXEL_CENTRE, centre[1] - PIXEL_CENTRE, 1.0]
    linear = matrix[:2, :2]
    turned = linear @ velocity
    place = moved[:2] / moved[2] + PIXEL_CENTRE + turned * dt_s
    return place, turned, float(np.sqrt(abs(np.linalg.det(linear))))
