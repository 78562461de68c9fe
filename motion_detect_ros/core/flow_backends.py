"""Dense optical flow methods behind one function type; ``make_flow`` is the registry.

Every method gives the displacement from the current image to the earlier one, so ``earlier[p + flow[p]]`` shows what
``current[p]`` shows.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Protocol

import cv2
import numpy as np

from motion_detect_ros.core.config import OpticalFlowConfig
from motion_detect_ros.core.errors import BackendError
from motion_detect_ros.core.flow_contrib import CONTRIB
from motion_detect_ros.core.flow_onnx import OnnxFlow
from motion_detect_ros.core.types import ByteArray, FloatArray
from motion_detect_ros.core.warp import grid_points

#: Farneback: pyramid scale, levels, window, iterations, neighbourhood and its sigma (Farneback 2003; OpenCV's advice).
FARNEBACK = (0.5, 5, 15, 3, 5, 1.1)
#: Dense Lucas-Kanade: spacing of the points, window, and pyramid levels above the image.
LK_GRID_PX, LK_WINDOW_PX, LK_LEVELS = 6, 15, 4
#: Rounds and smoothness of the variational refinement at full resolution (Brox et al. 2004).
VARIATIONAL_ROUNDS, VARIATIONAL_SMOOTHNESS = 3, 10.0
#: Finest level of DIS that any picture allows, and the side that allows level 1, twice that for every level more.
SAFE_FINEST_SCALE, SAFE_SIDE_PX = 2, 16


class FlowFunction(Protocol):
    """A method of dense optical flow."""

    def __call__(self, current: ByteArray, earlier: ByteArray, start: FloatArray | None = None, /) -> FloatArray:
        """(h, w, 2) float32 displacement current -> earlier, pixels; NaN where the method has no answer.

        current, earlier: (h, w) uint8 of one size; start: (h, w, 2) float32 first guess, left as it is; only
        the methods of ``config.WARM_METHODS`` are ever given one, most others take no notice of it.
        """
        ...


def make_flow(config: OpticalFlowConfig) -> FlowFunction:
    """The method ``config.method``.

    Raises: BackendError where it is not in this installation; it names what to install.
    """
    if config.method == 'onnx':
        return OnnxFlow(config.onnx_model)
    make = {**BUILT_IN, **CONTRIB}.get(config.method)
    if make is None:
        raise BackendError(f'optical_flow.method: expected one of {", ".join((*BUILT_IN, *CONTRIB, "onnx"))}, '
                           f'got {config.method!r}')
    return make(config)


class Dis:
    """Dense inverse search (Kroeger et al. 2016); what is None is as in OpenCV's preset."""

    def __init__(self, preset: int, finest_scale: int | None = None, refinement_iterations: int | None = None,
                 smoothness: float | None = None) -> None:
        self._preset, self._finest_scale = preset, finest_scale
        self._refinement_iterations, self._smoothness = refinement_iterations, smoothness
        self._size: tuple[int, ...] = ()
        self._guessed = False

    def __call__(self, current: ByteArray, earlier: ByteArray, start: FloatArray | None = None, /) -> FloatArray:
        """As ``FlowFunction``; ``start`` is one more candidate for every patch."""
        # OpenCV's changes its own parameters for small pictures and keeps them; it keeps a first guess, too.
        if current.shape != self._size or (self._guessed and start is None):
            self._dis, self._size = self._make(min(current.shape)), current.shape
        self._guessed = start is not None
        flow: FloatArray = self._dis.calc(current, earlier, None if start is None else start.copy())
        return flow

    def _make(self, side_px: int) -> cv2.DISOpticalFlow:
        dis = cv2.DISOpticalFlow_create(self._preset)
        if self._finest_scale is not None:
            # OpenCV 5.0 writes beyond its arrays where a picture is small for a finest level over 2.
            safe = max(SAFE_FINEST_SCALE, int(math.log2(side_px / SAFE_SIDE_PX)))
            dis.setFinestScale(min(self._finest_scale, safe))
        if self._refinement_iterations is not None:
            dis.setVariationalRefinementIterations(self._refinement_iterations)
        if self._smoothness is not None:
            dis.setVariationalRefinementAlpha(self._smoothness)
        return dis


class Variational:
    """Dense inverse search, then one variational refinement at full resolution (Brox et al. 2004)."""

    def __init__(self, finest_scale: int) -> None:
        self._dis = Dis(cv2.DISOPTICAL_FLOW_PRESET_FAST, finest_scale, 0)
        self._refinement = cv2.VariationalRefinement_create()
        self._refinement.setFixedPointIterations(VARIATIONAL_ROUNDS)
        self._refinement.setAlpha(VARIATIONAL_SMOOTHNESS)

    def __call__(self, current: ByteArray, earlier: ByteArray, start: FloatArray | None = None, /) -> FloatArray:
        """As ``FlowFunction``."""
        flow: FloatArray = self._refinement.calc(current, earlier, self._dis(current, earlier, start))
        return flow


def farneback(current: ByteArray, earlier: ByteArray, start: FloatArray | None = None, /) -> FloatArray:
    """Polynomial expansion (Farneback 2003). As ``FlowFunction``."""
    flags = 0 if start is None else cv2.OPTFLOW_USE_INITIAL_FLOW
    flow: FloatArray = cv2.calcOpticalFlowFarneback(
        current, earlier, None if start is None else start.copy(), *FARNEBACK, flags)
    return flow


def dense_lucas_kanade(current: ByteArray, earlier: ByteArray, start: FloatArray | None = None, /) -> FloatArray:
    """Pyramidal Lucas-Kanade (Bouguet 2001) on a grid of points, linear in between. As ``FlowFunction``.

    NaN around points that the tracker loses: plain ground, and what leaves the image.
    """
    height, width = current.shape
    rows, columns = max(1, round(height / LK_GRID_PX)), max(1, round(width / LK_GRID_PX))
    points = grid_points(rows, columns, width, height).reshape(-1, 1, 2)
    guess, flags = None, 0
    if start is not None:
        guess, flags = points + cv2.remap(start, points, None, cv2.INTER_LINEAR), cv2.OPTFLOW_USE_INITIAL_FLOW
    found, known, _ = cv2.calcOpticalFlowPyrLK(
        current, earlier, points, guess, winSize=(LK_WINDOW_PX, LK_WINDOW_PX), maxLevel=LK_LEVELS, flags=flags)
    moved = found - points
    moved[known.ravel() == 0] = np.nan
    flow: FloatArray = cv2.resize(moved.reshape(rows, columns, 2), (width, height), interpolation=cv2.INTER_LINEAR)
    return flow


#: Methods that come with every OpenCV: name -> what makes it.
BUILT_IN: dict[str, Callable[[OpticalFlowConfig], FlowFunction]] = {
    'dis': lambda config: Dis(
        cv2.DISOPTICAL_FLOW_PRESET_FAST, config.finest_scale, config.refinement_iterations, config.smoothness),
    'dis_ultrafast': lambda _: Dis(cv2.DISOPTICAL_FLOW_PRESET_ULTRAFAST),
    'dis_fast': lambda _: Dis(cv2.DISOPTICAL_FLOW_PRESET_FAST),
    'dis_medium': lambda _: Dis(cv2.DISOPTICAL_FLOW_PRESET_MEDIUM),
    'farneback': lambda _: farneback,
    'lk': lambda _: dense_lucas_kanade,
    'variational': lambda config: Variational(config.finest_scale),
}
