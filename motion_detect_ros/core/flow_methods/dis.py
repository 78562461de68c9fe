"""Dense inverse search (Kroeger et al. 2016), the default method, OpenCV's implementation."""

from __future__ import annotations

import math

import cv2

from motion_detect_ros.core.types import ByteArray, FloatArray

#: Finest level of DIS that any image allows, and the side that allows level 1, twice that for every level more.
SAFE_FINEST_SCALE, SAFE_SIDE_PX = 2, 16


class Dis:
    """A ``FlowFunction``; None keeps the value of OpenCV's preset."""

    def __init__(self, preset: int, finest_scale: int | None = None, refinement_iterations: int | None = None,
                 smoothness: float | None = None) -> None:
        self._preset, self._finest_scale = preset, finest_scale
        self._refinement_iterations, self._smoothness = refinement_iterations, smoothness
        self._size: tuple[int, ...] = ()

    def __call__(self, current: ByteArray, reference: ByteArray, /) -> FloatArray:
        """As ``FlowFunction``."""
        if current.shape != self._size:  # OpenCV's changes its own parameters for small images and keeps them
            self._dis, self._size = self._make(min(current.shape)), current.shape
        flow: FloatArray = self._dis.calc(current, reference, None)
        return flow

    def _make(self, side_px: int) -> cv2.DISOpticalFlow:
        dis = cv2.DISOpticalFlow_create(self._preset)
        if self._finest_scale is not None:
            # OpenCV 5.0 writes beyond its arrays where an image is small for a finest level over 2.
            safe = max(SAFE_FINEST_SCALE, int(math.log2(side_px / SAFE_SIDE_PX)))
            dis.setFinestScale(min(self._finest_scale, safe))
        if self._refinement_iterations is not None:
            dis.setVariationalRefinementIterations(self._refinement_iterations)
        if self._smoothness is not None:
            dis.setVariationalRefinementAlpha(self._smoothness)
        return dis
