"""Classical flow methods that every OpenCV has: Farneback, Lucas-Kanade on a grid, variational refinement."""

from __future__ import annotations

import cv2
import numpy as np

from motion_detect_ros.core.flow_methods.dis import Dis
from motion_detect_ros.core.geometry.warp import grid_points
from motion_detect_ros.core.types import ByteArray, FloatArray

#: Farneback: pyramid scale, levels, window, iterations, neighbourhood and its sigma (Farneback 2003; OpenCV's advice).
FARNEBACK = (0.5, 5, 15, 3, 5, 1.1)
#: Dense Lucas-Kanade: spacing of the points, window, and pyramid levels above the image.
LK_GRID_PX, LK_WINDOW_PX, LK_LEVELS = 6, 15, 4
#: Rounds and smoothness of the variational refinement at full resolution (Brox et al. 2004).
VARIATIONAL_ROUNDS, VARIATIONAL_SMOOTHNESS = 3, 10.0


class Variational:
    """Dense inverse search, then one variational refinement at full resolution (Brox et al. 2004)."""

    def __init__(self, finest_scale: int) -> None:
        self._dis = Dis(cv2.DISOPTICAL_FLOW_PRESET_FAST, finest_scale, 0)
        self._refinement = cv2.VariationalRefinement_create()
        self._refinement.setFixedPointIterations(VARIATIONAL_ROUNDS)
        self._refinement.setAlpha(VARIATIONAL_SMOOTHNESS)

    def __call__(self, current: ByteArray, reference: ByteArray, /) -> FloatArray:
        """As ``FlowFunction``."""
        flow: FloatArray = self._refinement.calc(current, reference, self._dis(current, reference))
        return flow


def farneback(current: ByteArray, reference: ByteArray, /) -> FloatArray:
    """Polynomial expansion (Farneback 2003). As ``FlowFunction``."""
    flow: FloatArray = cv2.calcOpticalFlowFarneback(current, reference, None, *FARNEBACK, 0)
    return flow


def dense_lucas_kanade(current: ByteArray, reference: ByteArray, /) -> FloatArray:
    """Pyramidal Lucas-Kanade (Bouguet 2001) on a grid of points, linear in between. As ``FlowFunction``.

    NaN around points that the tracker loses: plain ground, and what leaves the image.
    """
    height, width = current.shape
    rows, columns = max(1, round(height / LK_GRID_PX)), max(1, round(width / LK_GRID_PX))
    points = grid_points(rows, columns, width, height).reshape(-1, 1, 2)
    found, known, _ = cv2.calcOpticalFlowPyrLK(
        current, reference, points, None, winSize=(LK_WINDOW_PX, LK_WINDOW_PX), maxLevel=LK_LEVELS)
    moved = found - points
    moved[known.ravel() == 0] = np.nan
    flow: FloatArray = cv2.resize(moved.reshape(rows, columns, 2), (width, height), interpolation=cv2.INTER_LINEAR)
    return flow
