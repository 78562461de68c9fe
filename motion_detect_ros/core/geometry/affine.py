"""The six-parameter affine motion, about another origin.

dx = a0 + a1 x + a2 y,  dy = a3 + a4 x + a5 y   (Bergen et al. 1992, equation 7), with x, y the position of a
background point in the previous frame and dx, dy its displacement to the current one.
"""

from __future__ import annotations

import numpy as np

from motion_detect_ros.core.types import DoubleArray


def to_centre(centre: DoubleArray) -> DoubleArray:
    """(6, 6) change of parameters: about the origin -> about ``centre``, slopes times half the diagonal, in pixels."""
    reach = float(np.hypot(centre[0], centre[1]))
    block = np.array([[1.0, centre[0], centre[1]], [0.0, reach, 0.0], [0.0, 0.0, reach]])
    change = np.zeros((6, 6))
    change[:3, :3] = change[3:, 3:] = block
    return change
