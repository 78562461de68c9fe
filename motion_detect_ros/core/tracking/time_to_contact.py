"""Time to contact of camera and object."""

from __future__ import annotations

import math

from motion_detect_ros.core.detection.candidate import Growth

#: Least number of measurements, and deviations from zero from which the rate is significant.
MIN_GROWTHS, SIGNIFICANT = 4, 2.5
#: Initial deviation of the logarithm of the size.
UNKNOWN_SIZE = 100.0
#: Initial deviation of the rate, 1/s; its process noise by accelerations, 1/s per square root of s.
FIRST_RATE, RATE_DRIFT = 0.7, 0.03
#: Deviation of the logarithm of the box's size: from frame to frame, and what turning adds, per square root of s.
SIZE_NOISE, SIZE_DRIFT = 0.06, 0.03
#: Weight kept per update of the measured noise of the rates, weight of the assumed one, least scale.
KEPT_NOISE, ASSUMED_WEIGHT, MIN_NOISE = 0.9, 5.0, 0.25
#: Innovations over so many deviations increase the variance of the measurement accordingly.
GATE = 2.5
#: Correlation time of the errors of the flow, seconds.
SAME_S = 0.3
#: Largest prediction step, share of the time to contact.
MAX_STEP = 0.5


class Approach:
    """Extended Kalman filter of (logarithm of the size, rate g = closing speed / distance).

    At constant speed 1/g falls by dt in dt and the size grows by 1 / (1 - g dt) (Lee 1976). Both the growth of the
    flow and that of the box correct it, by the inverse of their variance.
    """

    def __init__(self) -> None:
        self._log_size, self._rate = 0.0, 0.0
        self._var_size, self._covariance, self._var_rate = UNKNOWN_SIZE ** 2, 0.0, FIRST_RATE ** 2
        self._growths = 0
        self._since_s = 0.0
        self._noise, self._noise_weight = 1.0, ASSUMED_WEIGHT

    @property
    def time_to_contact_s(self) -> float:
        """Distance over closing speed; +inf where the object recedes; NaN where the rate is not significant."""
        if self._growths < MIN_GROWTHS or abs(self._rate) < SIGNIFICANT * math.sqrt(self._var_rate):
            return math.nan
        return 1.0 / self._rate if self._rate > 0.0 else math.inf

    def predict(self, dt_s: float) -> None:
        """Predict over ``dt_s`` seconds at constant speed."""
        left = 1.0 - min(MAX_STEP, max(-MAX_STEP, self._rate * dt_s))
        self._log_size, self._rate = self._log_size - math.log(left), self._rate / left
        a, b = dt_s / left, 1.0 / left ** 2  # [[1, a], [0, b]]: how errors go on
        self._var_size += (2.0 * self._covariance + a * self._var_rate) * a + SIZE_DRIFT ** 2 * dt_s
        self._covariance = b * (self._covariance + a * self._var_rate)
        self._var_rate = b ** 2 * self._var_rate + RATE_DRIFT ** 2 * dt_s
        self._since_s += dt_s

    def update(self, growth: Growth | None) -> None:
        """Correct with the measurement of one frame, None = none."""
        if growth is None:
            return
        if math.isfinite(growth.log_size):
            weight = 1.0 / (self._var_size + SIZE_NOISE ** 2)
            self._correct(growth.log_size - self._log_size, weight, self._var_size, self._covariance)
        again = max(1.0, max(SAME_S, growth.seconds) / self._since_s) if self._since_s > 0.0 else 1.0
        weight = 1.0 / (self._var_rate + again * self._believed(growth))
        self._correct(growth.rate - self._rate, weight, self._covariance, self._var_rate)
        self._growths += 1
        self._since_s = 0.0

    def _believed(self, growth: Growth) -> float:
        """Variance of a measured rate, scaled by the innovations so far."""
        square = (growth.rate - self._rate) ** 2
        expected = growth.variance + self._var_rate
        kept = KEPT_NOISE * self._noise_weight
        self._noise = (kept * self._noise + min(square / expected, GATE ** 2)) / (kept + 1.0)
        self._noise_weight = kept + 1.0
        variance = growth.variance * max(MIN_NOISE, self._noise)
        return variance * max(1.0, square / (GATE ** 2 * (variance + self._var_rate)))

    def _correct(self, off: float, weight: float, with_size: float, with_rate: float) -> None:
        """Kalman update with innovation ``off``, its variance 1 / ``weight``, its covariances with size and rate."""
        self._log_size += weight * with_size * off
        self._rate += weight * with_rate * off
        self._var_size -= weight * with_size ** 2
        self._covariance -= weight * with_size * with_rate
        self._var_rate -= weight * with_rate ** 2
