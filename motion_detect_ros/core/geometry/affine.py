"""The six-parameter affine motion, from parameters to matrix.

dx = a0 + a1 x + a2 y,  dy = a3 + a4 x + a5 y   (Bergen et al. 1992, equation 7), with x, y the position of a
background point in the previous frame and dx, dy its displacement to the current one.
"""

from __future__ import annotations

import numpy as np

from motion_detect_ros.core.types import DoubleArray


def affine_matrix(params: DoubleArray) -> DoubleArray:
    """(6,) a0..a5 -> (3, 3) matrix that maps previous pixel to current pixel."""
    a0, a1, a2, a3, a4, a5 = params
    return np.array([[1.0 + a1, a2, a0], [a4, 1.0 + a5, a3], [0.0, 0.0, 1.0]])


def to_centre(centre: DoubleArray) -> DoubleArray:
    """(6, 6) change of parameters: about the origin -> about ``centre``, slopes times half the diagonal, in pixels."""
    reach = float(np.hypot(centre[0], centre[1]))
    block = np.array([[1.0, centre[0], centre[1]], [0.0, reach, 0.0], [0.0, 0.0, reach]])
    change = np.zeros((6, 6))
    change[:3, :3] = change[3:, 3:] = block
    return change
