"""Features of a flow field: what ART2 clusters, and what describes an object's motion.

Derivatives are central differences on the grid (one-sided at the border), per full-resolution pixel, so divergence
and curl have no unit but "per baseline": an expansion by the factor 1 + s has divergence 2 s, a rotation by w
radians has curl 2 w (Koenderink and van Doorn 1976).
"""

from __future__ import annotations

import numpy as np

from motion_detect_ros.core.background import Background
from motion_detect_ros.core.types import FloatArray


def motion_vectors(residual: FloatArray, background: Background) -> FloatArray:
    """(gh, gw, 2) motion against the background in units of its noise; NaN where the flow is unknown.

    residual: (gh, gw, 2) flow with the ego-motion taken out, pixels.
    """
    vectors: FloatArray = (residual - background.flow) / background.sigma_px[..., None]
    return vectors


def magnitude(flow: FloatArray) -> FloatArray:
    """(gh, gw) length of (gh, gw, 2) vectors, in their unit."""
    length: FloatArray = np.hypot(flow[..., 0], flow[..., 1])
    return length


def angle(flow: FloatArray) -> FloatArray:
    """(gh, gw) direction, radians in (-pi, pi], 0 along +x, positive towards +y (down in the image)."""
    direction: FloatArray = np.arctan2(flow[..., 1], flow[..., 0])
    return direction


def divergence(flow: FloatArray, cell_px: tuple[float, float]) -> FloatArray:
    """(gh, gw) d(dx)/dx + d(dy)/dy. flow: (gh, gw, 2) pixels; cell_px: width and height of a grid cell, pixels."""
    expansion: FloatArray = _along_x(flow[..., 0], cell_px) + _along_y(flow[..., 1], cell_px)
    return expansion


def curl(flow: FloatArray, cell_px: tuple[float, float]) -> FloatArray:
    """(gh, gw) d(dy)/dx - d(dx)/dy, positive for a turn from +x towards +y. Arguments as in ``divergence``."""
    turn: FloatArray = _along_x(flow[..., 1], cell_px) - _along_y(flow[..., 0], cell_px)
    return turn


def _along_x(component: FloatArray, cell_px: tuple[float, float]) -> FloatArray:
    return np.gradient(component, np.float32(cell_px[0]), axis=1).astype(np.float32)


def _along_y(component: FloatArray, cell_px: tuple[float, float]) -> FloatArray:
    return np.gradient(component, np.float32(cell_px[1]), axis=0).astype(np.float32)
