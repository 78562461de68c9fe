"""Dense optical flow methods by name: ``make_flow``."""

from __future__ import annotations

from collections.abc import Callable

import cv2

from motion_detect_ros.core.config import OpticalFlowConfig
from motion_detect_ros.core.errors import BackendError
from motion_detect_ros.core.flow_methods.alternatives.classical import Variational, dense_lucas_kanade, farneback
from motion_detect_ros.core.flow_methods.alternatives.contrib import CONTRIB
from motion_detect_ros.core.flow_methods.alternatives.onnx import OnnxFlow
from motion_detect_ros.core.flow_methods.dis import Dis
from motion_detect_ros.core.flow_methods.flow_function import FlowFunction


def make_flow(config: OpticalFlowConfig) -> FlowFunction:
    """The method ``config.method``.

    Raises: BackendError where it is not in this installation; it names what to install.
    """
    if config.method == 'onnx':
        return OnnxFlow(config.onnx_model)
    if config.method in CONTRIB:
        return CONTRIB[config.method]()
    if config.method not in BUILT_IN:
        raise BackendError(f'optical_flow.method: expected one of {", ".join((*BUILT_IN, *CONTRIB, "onnx"))}, '
                           f'got {config.method!r}')
    return BUILT_IN[config.method](config)


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
