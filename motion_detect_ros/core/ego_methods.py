"""Ways to measure the ego-motion, behind one type; ``make_method`` is the registry."""

from __future__ import annotations

from collections.abc import Callable

from motion_detect_ros.core.config import EgoMotionConfig
from motion_detect_ros.core.ego_direct import DirectMethod
from motion_detect_ros.core.ego_flow import FlowMethod
from motion_detect_ros.core.ego_indirect import IndirectMethod
from motion_detect_ros.core.ego_measured import EgoMethod
from motion_detect_ros.core.errors import ConfigError
from motion_detect_ros.core.still_camera import StillFirst


def make_method(config: EgoMotionConfig) -> EgoMethod:
    """The method ``config.method``; with ``config.static_px`` after a look whether the camera stands still.

    Raises: ConfigError for an unknown one; BackendError for features that this OpenCV does not have.
    """
    if config.method not in METHODS:
        raise ConfigError(f'ego_motion.method: expected one of {", ".join(METHODS)}, got {config.method!r}')
    method = METHODS[config.method](config)
    return StillFirst(config, method) if config.static_px > 0.0 else method


METHODS: dict[str, Callable[[EgoMotionConfig], EgoMethod]] = {
    'indirect': IndirectMethod,
    'direct': DirectMethod,
    'flow': FlowMethod,
}
