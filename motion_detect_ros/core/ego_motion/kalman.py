"""Kalman smoothing of the six affine ego-motion parameters.

Each parameter's rate of displacement has a Wiener-process acceleration (Bar-Shalom et al. 2001, section 6.3.3, discrete
form, of which the position is left out): state (rate, acceleration), measurement rate = parameter / dt, and the
acceleration changes by a random step of ``process_noise_px_per_s2`` from frame to frame. Parameters are about the
image centre and in pixels (``motion_models``), so one process noise fits all six.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from motion_detect_ros.core.config import EgoMotionConfig
from motion_detect_ros.core.types import NANOSECONDS, DoubleArray

#: Gate: squared Mahalanobis distance of 99.9 % of true six-parameter innovations (chi-square, 6 degrees).
GATE_CHI2_6 = 22.46
#: After this many rejected measurements in a row the filter restarts: the motion has changed.
MAX_REJECTED = 3

#: Expected parameters (6,), pixels -> whether the image shows the measured ones instead.
Shown = Callable[[DoubleArray], bool]


class ParameterKalman:
    """Smooths a0..a5 over time; outside of the gate it restarts or rejects, as the image says."""

    def __init__(self, config: EgoMotionConfig) -> None:
        self._config = config
        self.reset()

    def reset(self) -> None:
        """Clear the state; the next measurement initialises it."""
        self._state: DoubleArray = np.zeros(12)
        self._covariance: DoubleArray = np.zeros((12, 12))
        self._stamp_ns: int | None = None
        self._rejected = 0

    def update(
        self, params: DoubleArray, covariance: DoubleArray, stamp_ns: int, dt_s: float, shown: Shown,
    ) -> tuple[DoubleArray, DoubleArray, bool]:
        """Filtered parameters, their covariance, and whether the measurement was accepted.

        params: (6,), covariance: (6, 6) about the image centre, pixels over ``dt_s``; shown: asked outside of the gate.
        """
        accepted = self._step(params / dt_s, covariance / dt_s ** 2, stamp_ns, dt_s, shown)
        return self._state[:6] * dt_s, self._covariance[:6, :6] * dt_s ** 2, accepted

    def _step(self, measured: DoubleArray, noise: DoubleArray, stamp_ns: int, dt_s: float, shown: Shown) -> bool:
        if self._stamp_ns is None:
            self._start(measured, noise, stamp_ns)
            return True
        state, covariance = self._predict((stamp_ns - self._stamp_ns) / NANOSECONDS)
        innovation = measured - state[:6]
        spread = covariance[:6, :6] + noise
        if innovation @ np.linalg.solve(spread, innovation) > GATE_CHI2_6:
            self._rejected += 1
            if self._rejected < MAX_REJECTED and not shown(state[:6] * dt_s):
                return False
            self._start(measured, noise, stamp_ns)
            return True
        gain = np.linalg.solve(spread, covariance[:6, :]).T
        self._state = state + gain @ innovation
        self._covariance = covariance - gain @ spread @ gain.T
        self._stamp_ns, self._rejected = stamp_ns, 0
        return True

    def _start(self, measured: DoubleArray, noise: DoubleArray, stamp_ns: int) -> None:
        self._state = np.r_[measured, np.zeros(6)]
        self._covariance = np.zeros((12, 12))
        self._covariance[:6, :6] = noise
        self._covariance[6:, 6:] = np.eye(6) * self._config.process_noise_px_per_s2 ** 2
        self._stamp_ns, self._rejected = stamp_ns, 0

    def _predict(self, dt_s: float) -> tuple[DoubleArray, DoubleArray]:
        transition = np.eye(12)
        transition[:6, 6:] = np.eye(6) * dt_s
        variance = self._config.process_noise_px_per_s2 ** 2
        ramp = np.vstack([np.eye(6) * dt_s, np.eye(6)])
        process = variance * ramp @ ramp.T
        return transition @ self._state, transition @ self._covariance @ transition.T + process
