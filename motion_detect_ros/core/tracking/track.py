"""One track: Kalman filter of position and velocity against the background, log odds, coasting."""

from __future__ import annotations

import numpy as np

from motion_detect_ros.core.detection.candidate import Candidate
from motion_detect_ros.core.forgetting import kept
from motion_detect_ros.core.geometry.carried import carried
from motion_detect_ros.core.periods import exceeded
from motion_detect_ros.core.tracking.alternatives.appearance import Appearance
from motion_detect_ros.core.tracking.detected_time import DetectedTime
from motion_detect_ros.core.tracking.time_to_contact import Approach
from motion_detect_ros.core.types import DoubleArray

#: Measurement noise of a box centre, share of the box's side; and process noise of the velocity, shares per second.
CENTRE_SHARE = 0.12
ACCELERATION_SHARE = 2.0
MIN_CENTRE_PX = 1.0
#: Variance of the velocity, 1/s^2 of that of the centre: of a first detection, and of every later one (flow leaks).
FIRST_VELOCITY_RATIO, VELOCITY_RATIO = 16.0, 36.0
#: The process noise of small objects is that of this size at least, pixels.
MIN_ACCELERATION_PX = 8.0
#: Time constant of the log odds, seconds; log odds of a miss; their maximum; and the frame period of weight 1, seconds:
#: longer periods have a larger weight, so that the sum does not depend on the frame rate.
LOG_ODDS_MEMORY_S = 0.18
MISS_LOG_ODDS = -1.0
MAX_LOG_ODDS = 10.0
PERIOD_S = 0.04
#: Weight of a new size against the remembered one.
SIZE_GAIN = 0.4
#: How fast an object that is recognised by its appearance, but shows no motion, comes to rest, seconds.
REST_S = 0.08
#: Weight kept per update of the measured spread of the innovations, weight of the assumed spread, and least scale.
KEPT_SPREAD, PRIOR_UPDATES, MIN_SPREAD = 0.9, 5.0, 0.25
#: Weight kept per update of the mean velocity innovation, and weight of its square in the variance.
KEPT_LAG, LAG_WEIGHT = 0.6, 1.25


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

    def add(self, innovation: DoubleArray, covariance: DoubleArray) -> None:
        """One update of the filter. innovation: (4,); covariance: (4, 4), what the filter expected of it."""
        normalised = float(innovation @ np.linalg.solve(covariance, innovation)) / len(innovation)
        before = KEPT_SPREAD * self._weight
        self._scale = (before * self._scale + normalised) / (before + 1.0)
        self._weight = before + 1.0
        self._lag = KEPT_LAG * self._lag + (1.0 - KEPT_LAG) * innovation[2:]
        self._lag_weight = KEPT_LAG * self._lag_weight + 1.0 - KEPT_LAG

    def variance(self, assumed: DoubleArray) -> DoubleArray:
        """(2,) variance of the velocity where the filter says ``assumed``, (pixels/s)^2."""
        lag = self._lag / max(self._lag_weight, 1.0 - KEPT_LAG)
        corrected: DoubleArray = assumed * max(MIN_SPREAD, self._scale) + LAG_WEIGHT * lag ** 2
        return corrected


class Track:
    """State (u, v, du/dt, dv/dt): pixels and pixels/s, velocity against the background.

    Constant velocity with white acceleration: Bar-Shalom et al. 2001, section 6.3.2.
    """

    def __init__(self, seen: Candidate, dt_s: float, window_s: float) -> None:
        """dt_s: period of the frame it was seen in; window_s: of ``detected``; seconds."""
        self.id = 0
        self.state: DoubleArray = np.r_[seen.centre, seen.velocity_px_s]
        noise = self._noise(seen.size)
        velocity_noise = FIRST_VELOCITY_RATIO * noise
        self.covariance: DoubleArray = np.diag(np.r_[noise, noise, velocity_noise, velocity_noise])
        self.size = seen.size
        self.seen = seen
        self.age = 1
        self.coasted_s, self._coasted_frames = 0.0, 0
        self.detected = DetectedTime(window_s)
        self.detected.add(dt_s, True)
        self.log_odds = _weight(dt_s) * seen.log_odds
        self.gate_inflation_px = 0.0
        self.approach = Approach()
        self.approach.update(seen.growth)
        self.appearance: Appearance | None = None
        self.recognised_s = 0.0
        self._log_odds_seen = self.log_odds
        self._spread = Spread()

    @staticmethod
    def _noise(size: DoubleArray) -> float:
        return max(MIN_CENTRE_PX, CENTRE_SHARE * float(np.sqrt(size[0] * size[1]))) ** 2

    @property
    def velocity_variance(self) -> DoubleArray:
        """(2,) variance of the velocity, (pixels/s)^2, corrected by what was measured."""
        return self._spread.variance(np.diag(self.covariance)[2:])

    def inside(self, width: int, height: int) -> bool:
        """Whether the centre is on an image of ``width`` x ``height`` pixels."""
        return bool(0.0 <= self.state[0] < width and 0.0 <= self.state[1] < height)

    def visible(self, width: int, height: int) -> tuple[DoubleArray, DoubleArray]:
        """Centre and size of the part of the box that is on the image, (2,) each; edges at pixel borders."""
        low = np.maximum(self.state[:2] - self.size / 2.0, 0.0)
        high = np.minimum(self.state[:2] + self.size / 2.0, [width, height])
        return (low + high) / 2.0, high - low

    def predict(self, matrix: DoubleArray, dt_s: float) -> None:
        """Carry state, covariance and size over ``dt_s`` seconds: ego-motion of the position, then own velocity.

        matrix: (3, 3) previous pixel -> current pixel, full resolution.
        """
        self.approach.predict(dt_s)
        centre, velocity, scale = carried(matrix, self.state[:2], self.state[2:], dt_s)
        self.state = np.concatenate([centre, velocity])
        self.size = self.size * scale
        step = np.eye(4)
        step[0, 2] = step[1, 3] = dt_s
        acceleration = ACCELERATION_SHARE * max(MIN_ACCELERATION_PX, float(np.sqrt(self.size[0] * self.size[1])))
        ramp = np.array([[dt_s ** 2 / 2.0, 0.0], [0.0, dt_s ** 2 / 2.0], [dt_s, 0.0], [0.0, dt_s]]) * acceleration
        self.covariance = step @ self.covariance @ step.T + ramp @ ramp.T

    def predict_without_ego_motion(self, camera_px: float, dt_s: float) -> None:
        """The same with the camera's motion unknown: none is assumed, ``camera_px`` is its deviation along an axis."""
        self.predict(np.eye(3), dt_s)
        self.covariance[:2, :2] += np.eye(2) * camera_px ** 2
        self.gate_inflation_px = float(np.hypot(self.gate_inflation_px, camera_px))

    def update(self, seen: Candidate, dt_s: float) -> None:
        """Correct with a detection's centre and flow velocity (Kalman 1960); sizes are averaged, log odds add up."""
        position = self._noise(self.size)
        noise = np.diag([position, position, VELOCITY_RATIO * position, VELOCITY_RATIO * position])
        expected = self.covariance + noise
        innovation = np.concatenate([seen.centre, seen.velocity_px_s]) - self.state
        self._spread.add(innovation, expected)
        gain = np.linalg.solve(expected, self.covariance).T
        self.state = self.state + gain @ innovation
        self.covariance = self.covariance - gain @ self.covariance
        self.size = self.size + SIZE_GAIN * (seen.size - self.size)
        self._add_log_odds(seen.log_odds, _weight(dt_s), dt_s)
        self.approach.update(seen.growth)
        self.seen = seen
        self.coasted_s, self._coasted_frames = 0.0, 0
        self.recognised_s = 0.0
        self._log_odds_seen = self.log_odds
        self.gate_inflation_px = 0.0

    def coast_missed(self, dt_s: float) -> None:
        """A frame without a detection of the object."""
        self._add_log_odds(MISS_LOG_ODDS, min(1.0, _weight(dt_s)), dt_s)  # one miss, however long the period
        self._coast(dt_s)

    def coast_recognised(self, centre: DoubleArray, dt_s: float, appearance_hold_s: float) -> None:
        """The object shows no motion but was recognised at ``centre``: log odds fade to 0 over ``appearance_hold_s``.

        centre: (2,) full-resolution pixels; dt_s: since the last frame, seconds; appearance_hold_s: over 0, seconds.
        """
        self.recognised_s += dt_s
        noise = MIN_CENTRE_PX ** 2
        gain = self.covariance[:, :2] @ np.linalg.inv(self.covariance[:2, :2] + noise * np.eye(2))
        self.state = self.state + gain @ (centre - self.state[:2])
        self.state[2:] *= kept(dt_s, REST_S)
        self.covariance = self.covariance - gain @ self.covariance[:2]
        self.log_odds = self._log_odds_seen * max(0.0, 1.0 - self.recognised_s / appearance_hold_s)
        self.coasted_s, self._coasted_frames = 0.0, 0
        self.gate_inflation_px = 0.0

    def coast_unobserved(self, dt_s: float) -> None:
        """A frame in which detection was impossible: the log odds decay, nothing is added."""
        self._add_log_odds(0.0, 0.0, dt_s)
        self._coast(dt_s)

    def coasted_no_longer_than(self, seconds: float) -> bool:
        """Up to jitter of the period; one frame is always allowed unless none is (0 s)."""
        if not self._coasted_frames:
            return True
        period_s = self.coasted_s / self._coasted_frames
        return seconds > 0.0 and (
            self._coasted_frames == 1 or not exceeded(self.coasted_s, seconds, period_s))

    def _coast(self, dt_s: float) -> None:
        self.coasted_s += dt_s
        self._coasted_frames += 1

    def _add_log_odds(self, log_odds: float, weight: float, dt_s: float) -> None:
        before = kept(dt_s, LOG_ODDS_MEMORY_S) * self.log_odds
        self.log_odds = min(MAX_LOG_ODDS, before + weight * log_odds)


def _weight(dt_s: float) -> float:
    """Weight of the log odds of a frame of this period: the sum has the same limit at every frame rate."""
    return (1.0 - kept(dt_s, LOG_ODDS_MEMORY_S)) / (1.0 - kept(PERIOD_S, LOG_ODDS_MEMORY_S))
