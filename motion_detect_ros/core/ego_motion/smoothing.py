"""Interface and registry of the filters on the ego-motion's parameters."""

from __future__ import annotations

from collections.abc import Callable
from typing import Protocol

from motion_detect_ros.core.config import EgoMotionConfig
from motion_detect_ros.core.ego_motion.alternatives.autoregressive import ParameterAutoregression
from motion_detect_ros.core.ego_motion.kalman import ParameterKalman, Shown
from motion_detect_ros.core.errors import ConfigError
from motion_detect_ros.core.types import DoubleArray


class Smoother(Protocol):
    """Combines measured parameters with the prediction from earlier ones."""

    def reset(self) -> None:
        """Clear the state; the next measurement initialises it."""

    def update(
        self, params: DoubleArray, covariance: DoubleArray, stamp_ns: int, dt_s: float, shown: Shown,
    ) -> tuple[DoubleArray, DoubleArray, bool]:
        """Filtered parameters, their covariance, and whether the measurement was accepted.

        params: (6,), covariance: (6, 6) about the image centre, pixels over ``dt_s`` (``motion_models``); shown: asked
        where the measurement is far from what earlier ones foretell.
        """
        ...


class Unsmoothed:
    """No filter."""

    def reset(self) -> None:
        """Stateless."""

    def update(
        self, params: DoubleArray, covariance: DoubleArray, _stamp_ns: int, _dt_s: float, _shown: Shown,
    ) -> tuple[DoubleArray, DoubleArray, bool]:
        """The measurement unchanged."""
        return params, covariance, True


def make_smoother(config: EgoMotionConfig) -> Smoother:
    """The filter ``config.smoothing``. Raises: ConfigError for an unknown one."""
    if config.smoothing not in SMOOTHERS:
        raise ConfigError(f'ego_motion.smoothing: expected one of {", ".join(SMOOTHERS)}, got {config.smoothing!r}')
    return SMOOTHERS[config.smoothing](config)


SMOOTHERS: dict[str, Callable[[EgoMotionConfig], Smoother]] = {
    'kalman': ParameterKalman,
    'autoregressive': ParameterAutoregression,
    'none': lambda _: Unsmoothed(),
}
