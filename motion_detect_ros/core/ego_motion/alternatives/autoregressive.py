"""Autoregressive smoothing of the ego-motion's parameters: for cameras that shake periodically.

Each parameter's rate r (per second, about the image centre, pixels) is predicted from its last p measurements,
r_k = w1 r_(k-1) + .. + wp r_(k-p), p = ``ar_order``. The weights follow by recursive least squares with exponential
forgetting over ``ar_forgetting_s`` (Haykin 2002, chapter 9), from the last value alone as start. The prediction
and the measurement are averaged by their covariances; that of the prediction is measured on its last errors.
Frames must be equidistant. Some may be missing, or tell no motion: the rates of all up to the next one are predicted
then, one by one. Another frame rate restarts the filter. Frames whose motion the gyroscope tells are not counted.
"""

from __future__ import annotations

import numpy as np

from motion_detect_ros.core.config import EgoMotionConfig
from motion_detect_ros.core.ego_motion.kalman import GATE_CHI2_6, MAX_REJECTED, Shown
from motion_detect_ros.core.forgetting import kept
from motion_detect_ros.core.types import DoubleArray

#: Initial variance of a weight.
WEIGHT_VARIANCE = 1.0
#: Least variance of the prediction, share of the measurement's.
MIN_SHARE = 0.05
#: Share that the guess of the error, an acceleration of the process noise, keeps from frame to frame, and its least.
GUESS_KEPT, MIN_GUESS = 0.8, 1e-6
#: Ratio of frame periods from which the filter restarts, unless it is that of up to so many periods, for once.
MAX_PERIOD_RATIO, MAX_PERIODS = 1.5, 8
#: Weight of a new frame period against the remembered one, as stamps jitter.
PERIOD_WEIGHT = 0.2


class ParameterAutoregression:
    """Smooths a0..a5 over time; estimates outside of the gate it passes on or rejects, as the image says."""

    _period_s: float
    _rejected: int
    _bridged: bool

    def __init__(self, config: EgoMotionConfig) -> None:
        self._order = config.ar_order
        self._forgetting_s = config.ar_forgetting_s
        self._jump = config.process_noise_px_per_s2
        self.reset()

    def reset(self) -> None:
        """Clear the state; the next measurement is passed on unchanged."""
        self._start(np.empty((0, 6)), 0.0)

    def forecast(self, dt_s: float) -> DoubleArray | None:
        """(6,) parameters expected of the next frame, pixels over ``dt_s``; None before enough were measured."""
        return None if len(self._recent) < self._order else self._foretold(1).mean(axis=0) * dt_s

    def update(
        self, params: DoubleArray, covariance: DoubleArray, _stamp_ns: int, dt_s: float, shown: Shown,
    ) -> tuple[DoubleArray, DoubleArray, bool]:
        """Filtered parameters, their covariance, and whether the measurement was accepted.

        params: (6,), covariance: (6, 6) about the image centre, pixels over ``dt_s``; shown: asked outside of the gate.
        """
        periods = self._periods(dt_s)
        if len(self._recent) < self._order:
            self._remember((params / dt_s)[None])
            return params, covariance, True
        foretold = self._foretold(periods)
        expected: DoubleArray = foretold.mean(axis=0) * dt_s
        spread = self._forecast_covariance(covariance, dt_s)
        innovation = params - expected
        outside = innovation @ np.linalg.solve(spread + covariance, innovation) > GATE_CHI2_6
        if outside and not shown(expected):
            self._rejected += 1
            if self._rejected < MAX_REJECTED:
                return expected, covariance, False
            self._start((params / dt_s)[None], self._period_s)
            return params, covariance, True
        gain = np.eye(6) if outside else spread @ np.linalg.inv(spread + covariance)
        if periods == 1:
            self._learn(innovation / dt_s, np.diag(covariance) / dt_s ** 2, dt_s)
        self._remember(foretold + innovation / dt_s)
        self._rejected, self._bridged = 0, periods > 1
        return expected + gain @ innovation, gain @ covariance, True

    def _periods(self, dt_s: float) -> int:
        """How many frame periods ``dt_s`` is; restarts the filter where it is another period."""
        periods = max(1, round(dt_s / self._period_s)) if self._period_s else 1
        ratio = dt_s / (periods * self._period_s) if self._period_s else 1.0
        missing = periods > 1 and self._rejected == 0
        if (not 1.0 / MAX_PERIOD_RATIO < ratio < MAX_PERIOD_RATIO or periods > MAX_PERIODS
                or (missing and (self._bridged or len(self._recent) < self._order))):
            self.reset()
            periods = 1
        if periods == 1:
            self._period_s += (PERIOD_WEIGHT if self._period_s else 1.0) * (dt_s - self._period_s)
        return periods

    def _foretold(self, periods: int) -> DoubleArray:
        """(periods, 6) rates expected of the next periods, latest first."""
        recent = self._recent
        for _ in range(periods):
            recent = np.vstack([(self._weights * recent[:self._order].T).sum(axis=1), recent])
        return recent[:periods]

    def _start(self, recent: DoubleArray, period_s: float) -> None:
        self._recent = recent  # (n, 6) rates, latest first
        self._period_s = period_s
        self._rejected, self._bridged = 0, False  # bridged: frames before the last one were missing
        self._weights = np.zeros((6, self._order))
        self._weights[:, 0] = 1.0
        self._doubt = np.tile(WEIGHT_VARIANCE * np.eye(self._order), (6, 1, 1))
        self._errors = self._noise = np.zeros(6)  # sums, forgetting, of squared innovations and measured variances
        self._count, self._guess = 0.0, 1.0

    def _remember(self, rates: DoubleArray) -> None:
        """rates: (n, 6), latest first."""
        self._recent = np.vstack([rates, self._recent])[:self._order]

    def _squared_error(self, dt_s: float) -> DoubleArray:
        """(6,) of the rates' innovation; before there are many, as for an acceleration of the process noise."""
        guessed = self._guess * (self._jump * dt_s) ** 2
        squared: DoubleArray = (self._errors + guessed) / (self._count + self._guess)
        return squared

    def _forecast_covariance(self, covariance: DoubleArray, dt_s: float) -> DoubleArray:
        """(6, 6) of ``forecast``: squared innovations less the measurements' own variance."""
        own = self._squared_error(dt_s) - self._noise / max(self._count, 1.0)
        return np.diag(np.maximum(own * dt_s ** 2, MIN_SHARE * np.diag(covariance)))

    def _learn(self, innovation: DoubleArray, variance: DoubleArray, dt_s: float) -> None:
        """One step of recursive least squares for each parameter. innovation, variance: (6,) of the rates."""
        keep, noise = kept(dt_s, self._forgetting_s), self._squared_error(dt_s)
        past = self._recent.T
        along = np.einsum('kij,kj->ki', self._doubt, past)
        gain = along / (keep * noise + (past * along).sum(axis=1))[:, None]
        self._weights = self._weights + gain * innovation[:, None]
        doubt = (self._doubt - gain[:, :, None] * along[:, None, :]) / keep
        trace = np.trace(doubt, axis1=1, axis2=2)
        self._doubt = doubt * np.minimum(1.0, WEIGHT_VARIANCE * self._order / trace)[:, None, None]
        self._errors = keep * self._errors + innovation ** 2
        self._noise = keep * self._noise + variance
        self._count = keep * self._count + 1.0
        self._guess = max(GUESS_KEPT * self._guess, MIN_GUESS)
