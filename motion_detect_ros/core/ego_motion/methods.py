"""Registry of the ego-motion methods."""

from __future__ import annotations

from collections.abc import Callable

from motion_detect_ros.core.config import EgoMotionConfig
from motion_detect_ros.core.ego_motion.alternatives.direct import DirectMethod
from motion_detect_ros.core.ego_motion.alternatives.flow_based import FlowMethod
from motion_detect_ros.core.ego_motion.feature_based import IndirectMethod
from motion_detect_ros.core.ego_motion.measurement import EgoMethod
from motion_detect_ros.core.errors import ConfigError


def make_method(config: EgoMotionConfig) -> EgoMethod:
    """The method ``config.method``.

    Raises: ConfigError for an unknown one; BackendError for features that this OpenCV does not have.
    """
    if config.method not in METHODS:
        raise ConfigError(f'ego_motion.method: expected one of {", ".join(METHODS)}, got {config.method!r}')
    return METHODS[config.method](config)


METHODS: dict[str, Callable[[EgoMotionConfig], EgoMethod]] = {
    'indirect': IndirectMethod,
    'direct': DirectMethod,
    'flow': FlowMethod,
}
