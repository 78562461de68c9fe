"""When the camera and an object meet."""

from __future__ import annotations

import math

from motion_detect_ros.core.detection.candidate import Growth

#: Measurements before anything is said, and deviations from zero that count as an approach or a retreat.
MIN_GROWTHS, SIGNIFICANT = 4, 2.5
#: Deviation of the logarithm of the size before it is known.
UNKNOWN_SIZE = 100.0
#: Deviation of the rate before anything is measured, 1/s; of what accelerations change it by, 1/s per square root of s.
FIRST_RATE, RATE_DRIFT = 0.7, 0.03
#: Deviation of the logarithm of the box's size: from frame to frame, and what turning adds, per square root of s.
SIZE_NOISE, SIZE_DRIFT = 0.06, 0.03
#: Memory of the measured noise of the rates, weight of the assumed one, its smallest share.
KEPT_NOISE, ASSUMED_WEIGHT, MIN_NOISE = 0.9, 5.0, 0.25
#: A rate further than so many deviations from what was expected counts as that much noisier.
GATE = 2.5
#: For so long the errors of the flow stay the same, seconds.
SAME_S = 0.3
#: No step goes further than this share of the way to contact.
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
        """Distance over closing speed; +inf where it surely grows; NaN where neither is sure."""
        if self._growths < MIN_GROWTHS or abs(self._rate) < SIGNIFICANT * math.sqrt(self._var_rate):
            return math.nan
        return 1.0 / self._rate if self._rate > 0.0 else math.inf

    def predict(self, dt_s: float) -> None:
        """Go on at the same speed for ``dt_s``."""
        left = 1.0 - min(MAX_STEP, max(-MAX_STEP, self._rate * dt_s))
        self._log_size, self._rate = self._log_size - math.log(left), self._rate / left
        a, b = dt_s / left, 1.0 / left ** 2  # [[1, a], [0, b]]: how errors go on
        self._var_size += (2.0 * self._covariance + a * self._var_rate) * a + SIZE_DRIFT ** 2 * dt_s
        self._covariance = b * (self._covariance + a * self._var_rate)
        self._var_rate = b ** 2 * self._var_rate + RATE_DRIFT ** 2 * dt_s
        self._since_s += dt_s

    def update(self, growth: Growth | None) -> None:
        """Correct with what one frame shows, None = nothing."""
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
        """Variance of a measured rate, by its own account and by how it fitted so far."""
        square = (growth.rate - self._rate) ** 2
        expected = growth.variance + self._var_rate
        kept = KEPT_NOISE * self._noise_weight
        self._noise = (kept * self._noise + min(square / expected, GATE ** 2)) / (kept + 1.0)
        self._noise_weight = kept + 1.0
        variance = growth.variance * max(MIN_NOISE, self._noise)
        return variance * max(1.0, square / (GATE ** 2 * (variance + self._var_rate)))

    def _correct(self, off: float, weight: float, with_size: float, with_rate: float) -> None:
        """One measurement that is ``off``, of variance 1 / ``weight`` and such covariances with size and rate."""
        self._log_size += weight * with_size * off
        self._rate += weight * with_rate * off
        self._var_size -= weight * with_size ** 2
        self._covariance -= weight * with_size * with_rate
        self._var_rate -= weight * with_rate ** 2
