"""One track: motion, size, log odds, coasting."""

from __future__ import annotations

import math

import numpy as np

from motion_detect_ros.core.detection.candidate import Candidate
from motion_detect_ros.core.forgetting import kept
from motion_detect_ros.core.geometry.carried import length_scale
from motion_detect_ros.core.periods import exceeded
from motion_detect_ros.core.tracking.alternatives.appearance import Appearance
from motion_detect_ros.core.tracking.detected_time import DetectedTime
from motion_detect_ros.core.tracking.motion_filter import MotionFilter
from motion_detect_ros.core.tracking.time_to_contact import Approach
from motion_detect_ros.core.tracking.travel import Others, Travel
from motion_detect_ros.core.types import DoubleArray

#: Measurement noise of a box centre, share of the box's side; and process noise of the velocity, shares per second.
CENTRE_SHARE = 0.12
ACCELERATION_SHARE = 4.0
MIN_CENTRE_PX = 1.0
#: The process noise of small objects is that of this size at least, pixels.
MIN_ACCELERATION_PX = 8.0
#: Time constant of the log odds, seconds; log odds of a miss; their maximum; and the frame period of weight 1, seconds:
#: longer periods have a larger weight, so that the sum does not depend on the frame rate.
LOG_ODDS_MEMORY_S = 0.18
MISS_LOG_ODDS = -2.0
MAX_LOG_ODDS = 10.0
PERIOD_S = 0.04
#: Weight of a new size against the remembered one where they are alike; half of it where they differ by a factor of e
#: (Cauchy): a part, or two objects taken for one.
SIZE_GAIN = 0.3
#: How fast an object that is recognised by its appearance, but shows no motion, comes to rest, seconds.
REST_S = 0.08


class Track:
    """One object over time; times are seconds, lengths full-resolution pixels."""

    def __init__(self, seen: Candidate, dt_s: float, window_s: float) -> None:
        """dt_s: period of the frame it was seen in; window_s: of ``detected``; seconds."""
        self.id = 0
        self._filter = MotionFilter(seen.centre, seen.velocity_px_s, self._noise(seen.size))
        self.size = seen.size
        self.seen = seen
        self.age = 1
        self.coasted_s, self._coasted_frames = 0.0, 0
        self.detected = DetectedTime(window_s)
        self.detected.add(dt_s, True, seen.measured)
        self.log_odds = _weight(dt_s) * seen.log_odds
        self.travelled_log_odds = 0.0
        self._travel = Travel(seen.centre)
        self.gate_inflation_px = 0.0
        self.approach = Approach()
        self.approach.update(seen.growth)
        self.appearance: Appearance | None = None
        self.recognised_s = 0.0
        self._log_odds_seen = self.log_odds

    @staticmethod
    def _noise(size: DoubleArray) -> float:
        return max(MIN_CENTRE_PX, CENTRE_SHARE * math.sqrt(size[0] * size[1])) ** 2

    @property
    def state(self) -> DoubleArray:
        """(4,) u, v, du/dt, dv/dt: pixels and pixels/s, velocity against the background."""
        return self._filter.state

    @property
    def belief(self) -> float:
        """Log odds of the frames and of the way together."""
        return self.log_odds + self.travelled_log_odds

    def weigh_travel(self, others: Others) -> None:
        """What the way since the start tells, unless it has stopped or one of the others is larger and close."""
        centre = self.state[:2]
        added = 0.0 if self.recognised_s else self._travel.log_odds(centre, self.size)
        self.travelled_log_odds = 0.0 if added and others.holds_larger(centre, self.size) else added

    @property
    def velocity_variance(self) -> DoubleArray:
        """(2,) variance of the velocity, (pixels/s)^2, corrected by what was measured."""
        return self._filter.velocity_variance

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
        self.size = self.size * length_scale(matrix)
        side = max(MIN_ACCELERATION_PX, math.sqrt(self.size[0] * self.size[1]))
        self._filter.predict(matrix, dt_s, ACCELERATION_SHARE * side)
        self._travel.predict(matrix, dt_s)

    def predict_without_ego_motion(self, camera_px: float, dt_s: float) -> None:
        """The same with the camera's motion unknown: none is assumed, ``camera_px`` is its deviation along an axis."""
        self.predict(np.eye(3), dt_s)
        self._filter.widen(camera_px ** 2)
        self.gate_inflation_px = float(np.hypot(self.gate_inflation_px, camera_px))

    def update(self, seen: Candidate, dt_s: float) -> None:
        """Correct with a detection's centre and flow velocity (Kalman 1960); sizes are averaged, log odds add up."""
        mismatch = np.log(seen.size / self.size)
        self._filter.correct(seen.centre, seen.velocity_px_s, self._noise(self.size))
        self.size = self.size + SIZE_GAIN / (1.0 + mismatch * mismatch) * (seen.size - self.size)
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
        self._filter.correct_place(centre, MIN_CENTRE_PX ** 2)
        self.state[2:] *= kept(dt_s, REST_S)
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
