"""Optical flow methods of OpenCV's contributed modules (``cv2.optflow``), where they are installed."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import cv2

from motion_detect_ros.core.errors import BackendError
from motion_detect_ros.core.flow_methods.flow_function import FlowFunction
from motion_detect_ros.core.types import ByteArray, FloatArray

#: SimpleFlow: pyramid layers, averaging block and largest flow on a layer (Tao et al. 2012).
SIMPLE_FLOW = (3, 2, 4)
#: Spacing of the tracked points of the dense RLOF; the flow between them is interpolated along edges.
RLOF_GRID = (6, 6)


def optflow(method: str, function: str) -> Any:
    """A function of ``cv2.optflow``. Raises: BackendError where it is missing; it says what to install."""
    found = getattr(getattr(cv2, 'optflow', None), function, None)
    if found is None:
        raise BackendError(
            f'optical_flow.method {method}: expected cv2.optflow.{function}, OpenCV {cv2.__version__} here has none; '
            'install opencv-contrib-python-headless in place of opencv-python-headless '
            '(extra contrib of motion_detect_ros)')
    return found


class _Algorithm:
    """A ``cv2.DenseOpticalFlow`` that takes grey images."""

    def __init__(self, algorithm: Any) -> None:
        self._algorithm = algorithm

    def __call__(self, current: ByteArray, reference: ByteArray, /) -> FloatArray:
        flow: FloatArray = self._algorithm.calc(current, reference, None)
        return flow


class _SimpleFlow:
    """SimpleFlow (Tao et al. 2012): block matching with bilateral weights; wants three channels."""

    def __init__(self, function: Callable[..., Any]) -> None:
        self._function = function

    def __call__(self, current: ByteArray, reference: ByteArray, /) -> FloatArray:
        flow: FloatArray = self._function(_colour(current), _colour(reference), *SIMPLE_FLOW)
        return flow


class _DenseRlof:
    """Robust local optical flow (Geistert et al. 2016) on a grid, interpolated; wants three channels."""

    def __init__(self, create: Callable[..., Any]) -> None:
        self._algorithm = create()
        self._algorithm.setGridStep(RLOF_GRID)

    def __call__(self, current: ByteArray, reference: ByteArray, /) -> FloatArray:
        flow: FloatArray = self._algorithm.calc(_colour(current), _colour(reference), None)
        return flow


def _colour(gray: ByteArray) -> ByteArray:
    colour: ByteArray = cv2.cvtColor(gray, cv2.COLOR_GRAY2BGR)
    return colour


#: Name -> what makes it; raises BackendError where the contributed modules are missing.
CONTRIB: dict[str, Callable[[], FlowFunction]] = {
    'dual_tvl1': lambda: _Algorithm(optflow('dual_tvl1', 'DualTVL1OpticalFlow_create')()),
    'deepflow': lambda: _Algorithm(optflow('deepflow', 'createOptFlow_DeepFlow')()),
    'simpleflow': lambda: _SimpleFlow(optflow('simpleflow', 'calcOpticalFlowSF')),
    'rlof': lambda: _DenseRlof(optflow('rlof', 'DenseRLOFOpticalFlow_create')),
    'pcaflow': lambda: _Algorithm(optflow('pcaflow', 'createOptFlow_PCAFlow')()),
}
