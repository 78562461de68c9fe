"""Kalman filter of an object's position and velocity against the background (Kalman 1960).

Constant velocity with white acceleration: Bar-Shalom et al. 2001, section 6.3.2. All noise is the same along both axes,
so they stay independent with equal covariances: three numbers instead of a matrix of 4 x 4.
"""

from __future__ import annotations

from motion_detect_ros.core.geometry.carried import Rows, carried
from motion_detect_ros.core.geometry.vectors import Pair

#: Variance of the velocity, 1/s^2 of that of the centre: of a first detection, and of every later one (flow leaks).
FIRST_VELOCITY_RATIO, VELOCITY_RATIO = 16.0, 36.0
#: Weight kept per update of the measured spread of the innovations, weight of the assumed spread, and least scale.
KEPT_SPREAD, PRIOR_UPDATES, MIN_SPREAD = 0.9, 5.0, 0.25
#: Weight kept per update of the mean velocity innovation, and weight of its square in the variance.
KEPT_LAG, LAG_WEIGHT = 0.6, 1.25


class MotionFilter:
    """``centre``: u, v, pixels; ``velocity``: du/dt, dv/dt against the background, pixels/s."""

    def __init__(self, centre: Pair, velocity: Pair, noise: float) -> None:
        """noise: variance of a measured centre along an axis, pixels^2."""
        self.centre, self.velocity = centre, velocity
        self._place, self._both, self._speed = noise, 0.0, FIRST_VELOCITY_RATIO * noise
        self._spread = Spread()

    @property
    def velocity_variance(self) -> Pair:
        """Variance of the velocity along both axes, (pixels/s)^2, corrected by what was measured."""
        return self._spread.variance(self._speed)

    def predict(self, rows: Rows, dt_s: float, acceleration_px_s2: float) -> None:
        """Go on for ``dt_s`` seconds: ego-motion of the position, then own velocity.

        rows: of the warp previous pixel -> current pixel, full resolution; acceleration_px_s2: deviation.
        """
        self.centre, self.velocity = carried(rows, self.centre, self.velocity, dt_s)
        added = acceleration_px_s2 ** 2
        self._place += (2.0 * self._both + self._speed * dt_s) * dt_s + added * dt_s ** 4 / 4.0
        self._both += self._speed * dt_s + added * dt_s ** 3 / 2.0
        self._speed += added * dt_s ** 2

    def widen(self, variance: float) -> None:
        """The position is less certain by a variance along each axis, pixels^2."""
        self._place += variance

    def correct(self, centre: Pair, velocity: Pair, noise: float) -> None:
        """A measured centre, of variance ``noise``, and velocity."""
        s_place, s_speed = self._place + noise, self._speed + VELOCITY_RATIO * noise
        weight = 1.0 / (s_place * s_speed - self._both ** 2)
        (u, v), (du, dv) = self.centre, self.velocity
        off_u, off_v, lag_u, lag_v = centre[0] - u, centre[1] - v, velocity[0] - du, velocity[1] - dv
        squared = weight * (s_speed * (off_u * off_u + off_v * off_v) + s_place * (lag_u * lag_u + lag_v * lag_v)
                            - 2.0 * self._both * (off_u * lag_u + off_v * lag_v))
        self._spread.add(squared / 4.0, (lag_u, lag_v))
        # rows of the gain: position and velocity, each from the two innovations
        place_place = weight * (self._place * s_speed - self._both ** 2)
        place_speed = weight * self._both * (s_place - self._place)
        speed_place = weight * self._both * (s_speed - self._speed)
        speed_speed = weight * (self._speed * s_place - self._both ** 2)
        self.centre = (u + (place_place * off_u + place_speed * lag_u), v + (place_place * off_v + place_speed * lag_v))
        self.velocity = (du + (speed_place * off_u + speed_speed * lag_u),
                         dv + (speed_place * off_v + speed_speed * lag_v))
        place, both, speed = self._place, self._both, self._speed
        self._place = place - place_place * place - place_speed * both
        self._both = both - place_place * both - place_speed * speed
        self._speed = speed - speed_place * both - speed_speed * speed

    def correct_place(self, centre: Pair, noise: float) -> None:
        """A measured centre, of variance ``noise``."""
        (u, v), (du, dv) = self.centre, self.velocity
        off_u, off_v = centre[0] - u, centre[1] - v
        to_place, to_speed = (each / (self._place + noise) for each in (self._place, self._both))
        self.centre = u + to_place * off_u, v + to_place * off_v
        self.velocity = du + to_speed * off_u, dv + to_speed * off_v
        self._speed -= to_speed * self._both
        self._both -= to_place * self._both
        self._place -= to_place * self._place

    def slow(self, share: float) -> None:
        """Only this share of the velocity is left, 0 .. 1."""
        self.velocity = self.velocity[0] * share, self.velocity[1] * share


class Spread:
    """Variance of the filter's velocity, corrected by its innovations.

    The filter's own covariance is as good as the noise it assumes. Two measured figures correct it: the mean normalised
    innovation squared (Bar-Shalom et al. 2001, section 5.4), which scales it, and the mean velocity innovation, which
    noise does not have: it is the lag behind an object that accelerates, or a flow that is off to one side.
    """

    def __init__(self) -> None:
        self._scale = 1.0
        self._weight = PRIOR_UPDATES
        self._lag: Pair = (0.0, 0.0)
        self._lag_weight = 0.0

    def add(self, normalised: float, lag: Pair) -> None:
        """One update of the filter. normalised: innovation squared over what was expected of it, 1 on average;
        lag: innovation of the velocity, pixels/s.
        """
        before = KEPT_SPREAD * self._weight
        self._scale = (before * self._scale + normalised) / (before + 1.0)
        self._weight = before + 1.0
        self._lag = (KEPT_LAG * self._lag[0] + (1.0 - KEPT_LAG) * lag[0],
                     KEPT_LAG * self._lag[1] + (1.0 - KEPT_LAG) * lag[1])
        self._lag_weight = KEPT_LAG * self._lag_weight + 1.0 - KEPT_LAG

    def variance(self, assumed: float) -> Pair:
        """Variance of the velocity along both axes where the filter says ``assumed``, (pixels/s)^2."""
        weight, scaled = max(self._lag_weight, 1.0 - KEPT_LAG), assumed * max(MIN_SPREAD, self._scale)
        lag_u, lag_v = self._lag[0] / weight, self._lag[1] / weight
        return scaled + LAG_WEIGHT * (lag_u * lag_u), scaled + LAG_WEIGHT * (lag_v * lag_v)
