"""Kalman filter of an object's position and velocity against the background (Kalman 1960).

Constant velocity with white acceleration: Bar-Shalom et al. 2001, section 6.3.2. All noise is the same along both axes,
so they stay independent with equal covariances: three numbers instead of a matrix of 4 x 4.
"""

from __future__ import annotations

import numpy as np

from motion_detect_ros.core.geometry.carried import carried
from motion_detect_ros.core.types import DoubleArray

#: Variance of the velocity, 1/s^2 of that of the centre: of a first detection, and of every later one (flow leaks).
FIRST_VELOCITY_RATIO, VELOCITY_RATIO = 16.0, 36.0
#: Weight kept per update of the measured spread of the innovations, weight of the assumed spread, and least scale.
KEPT_SPREAD, PRIOR_UPDATES, MIN_SPREAD = 0.9, 5.0, 0.25
#: Weight kept per update of the mean velocity innovation, and weight of its square in the variance.
KEPT_LAG, LAG_WEIGHT = 0.6, 1.25


class MotionFilter:
    """``state``: (4,) u, v, du/dt, dv/dt, pixels and pixels/s, velocity against the background."""

    def __init__(self, centre: DoubleArray, velocity: DoubleArray, noise: float) -> None:
        """noise: variance of a measured centre along an axis, pixels^2."""
        self.state: DoubleArray = np.concatenate([centre, velocity])
        self._place, self._both, self._speed = noise, 0.0, FIRST_VELOCITY_RATIO * noise
        self._spread = Spread()

    @property
    def velocity_variance(self) -> DoubleArray:
        """(2,) variance of the velocity, (pixels/s)^2, corrected by what was measured."""
        return self._spread.variance(self._speed)

    def predict(self, matrix: DoubleArray, dt_s: float, acceleration_px_s2: float) -> None:
        """Go on for ``dt_s`` seconds: ego-motion of the position, then own velocity.

        matrix: (3, 3) previous pixel -> current pixel, full resolution; acceleration_px_s2: deviation.
        """
        self.state = np.concatenate(carried(matrix, self.state[:2], self.state[2:], dt_s))
        added = acceleration_px_s2 ** 2
        self._place += (2.0 * self._both + self._speed * dt_s) * dt_s + added * dt_s ** 4 / 4.0
        self._both += self._speed * dt_s + added * dt_s ** 3 / 2.0
        self._speed += added * dt_s ** 2

    def widen(self, variance: float) -> None:
        """The position is less certain by a variance along each axis, pixels^2."""
        self._place += variance

    def correct(self, centre: DoubleArray, velocity: DoubleArray, noise: float) -> None:
        """A measured centre, of variance ``noise``, and velocity, (2,) each."""
        innovation = np.concatenate([centre, velocity]) - self.state
        s_place, s_speed = self._place + noise, self._speed + VELOCITY_RATIO * noise
        weight = 1.0 / (s_place * s_speed - self._both ** 2)
        off, lag = innovation[:2], innovation[2:]
        squared = weight * (s_speed * off @ off - 2.0 * self._both * off @ lag + s_place * lag @ lag)
        self._spread.add(float(squared) / 4.0, lag)
        # rows of the gain: position and velocity, each from the two innovations
        place_place = weight * (self._place * s_speed - self._both ** 2)
        place_speed = weight * self._both * (s_place - self._place)
        speed_place = weight * self._both * (s_speed - self._speed)
        speed_speed = weight * (self._speed * s_place - self._both ** 2)
        self.state[:2] += place_place * off + place_speed * lag
        self.state[2:] += speed_place * off + speed_speed * lag
        place, both, speed = self._place, self._both, self._speed
        self._place = place - place_place * place - place_speed * both
        self._both = both - place_place * both - place_speed * speed
        self._speed = speed - speed_place * both - speed_speed * speed

    def correct_place(self, centre: DoubleArray, noise: float) -> None:
        """A measured centre, (2,), of variance ``noise``."""
        off = centre - self.state[:2]
        to_place, to_speed = (each / (self._place + noise) for each in (self._place, self._both))
        self.state[:2] += to_place * off
        self.state[2:] += to_speed * off
        self._speed -= to_speed * self._both
        self._both -= to_place * self._both
        self._place -= to_place * self._place


class Spread:
    """Variance of the filter's velocity, corrected by its innovations.

    The filter's own covariance is as good as the noise it assumes. Two measured figures correct it: the mean normalised
    innovation squared (Bar-Shalom et al. 2001, section 5.4), which scales it, and the mean velocity innovation, which
    noise does not have: it is the lag behind an object that accelerates, or a flow that is off to one side.
    """

    def __init__(self) -> None:
        self._scale = 1.0
        self._weight = PRIOR_UPDATES
        self._lag: DoubleArray = np.zeros(2)
        self._lag_weight = 0.0

    def add(self, normalised: float, lag: DoubleArray) -> None:
        """One update of the filter. normalised: innovation squared over what was expected of it, 1 on average;
        lag: (2,) innovation of the velocity, pixels/s.
        """
        before = KEPT_SPREAD * self._weight
        self._scale = (before * self._scale + normalised) / (before + 1.0)
        self._weight = before + 1.0
        self._lag = KEPT_LAG * self._lag + (1.0 - KEPT_LAG) * lag
        self._lag_weight = KEPT_LAG * self._lag_weight + 1.0 - KEPT_LAG

    def variance(self, assumed: float) -> DoubleArray:
        """(2,) variance of the velocity where the filter says ``assumed``, (pixels/s)^2."""
        lag = self._lag / max(self._lag_weight, 1.0 - KEPT_LAG)
        corrected: DoubleArray = assumed * max(MIN_SPREAD, self._scale) + LAG_WEIGHT * lag ** 2
        return corrected
