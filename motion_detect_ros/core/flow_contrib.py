"""Optical flow methods of OpenCV's contributed modules (``cv2.optflow``), where they are installed."""

from __future__ import annotations

from collections.abc import Callable
from typing import TYPE_CHECKING, Any

import cv2

from motion_detect_ros.core.config import OpticalFlowConfig
from motion_detect_ros.core.errors import BackendError
from motion_detect_ros.core.types import ByteArray, FloatArray

if TYPE_CHECKING:
    from motion_detect_ros.core.flow_backends import FlowFunction

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

    def __call__(self, current: ByteArray, earlier: ByteArray, start: FloatArray | None = None, /) -> FloatArray:
        flow: FloatArray = self._algorithm.calc(current, earlier, None)
        return flow


class _TvL1:
    """Dual TV-L1 (Zach et al. 2007), the one contributed method that takes a first guess; no setting gives it one."""

    def __init__(self, algorithm: Any) -> None:
        self._algorithm = algorithm

    def __call__(self, current: ByteArray, earlier: ByteArray, start: FloatArray | None = None, /) -> FloatArray:
        self._algorithm.setUseInitialFlow(start is not None)
        flow: FloatArray = self._algorithm.calc(current, earlier, None if start is None else start.copy())
        return flow


class _SimpleFlow:
    """SimpleFlow (Tao et al. 2012): block matching with bilateral weights; wants three channels."""

    def __init__(self, function: Callable[..., Any]) -> None:
        self._function = function

    def __call__(self, current: ByteArray, earlier: ByteArray, start: FloatArray | None = None, /) -> FloatArray:
        flow: FloatArray = self._function(_colour(current), _colour(earlier), *SIMPLE_FLOW)
        return flow


class _DenseRlof:
    """Robust local optical flow (Geistert et al. 2016) on a grid, interpolated; wants three channels."""

    def __init__(self, create: Callable[..., Any]) -> None:
        self._algorithm = create()
        self._algorithm.setGridStep(RLOF_GRID)

    def __call__(self, current: ByteArray, earlier: ByteArray, start: FloatArray | None = None, /) -> FloatArray:
        flow: FloatArray = self._algorithm.calc(_colour(current), _colour(earlier), None)
        return flow


def _colour(gray: ByteArray) -> ByteArray:
    colour: ByteArray = cv2.cvtColor(gray, cv2.COLOR_GRAY2BGR)
    return colour


#: Name -> what makes it; raises BackendError where the contributed modules are missing.
CONTRIB: dict[str, Callable[[OpticalFlowConfig], FlowFunction]] = {
    'dual_tvl1': lambda _: _TvL1(optflow('dual_tvl1', 'DualTVL1OpticalFlow_create')()),
    'deepflow': lambda _: _Algorithm(optflow('deepflow', 'createOptFlow_DeepFlow')()),
    'simpleflow': lambda _: _SimpleFlow(optflow('simpleflow', 'calcOpticalFlowSF')),
    'rlof': lambda _: _DenseRlof(optflow('rlof', 'DenseRLOFOpticalFlow_create')),
    'pcaflow': lambda _: _Algorithm(optflow('pcaflow', 'createOptFlow_PCAFlow')()),
}
