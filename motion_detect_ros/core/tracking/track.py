"""One track: motion, size, log odds, coasting."""

from __future__ import annotations

import math

from motion_detect_ros.core.detection.candidate import Candidate
from motion_detect_ros.core.forgetting import kept
from motion_detect_ros.core.geometry.carried import Rows, length_scale
from motion_detect_ros.core.geometry.vectors import Pair, pair
from motion_detect_ros.core.periods import exceeded
from motion_detect_ros.core.tracking.alternatives.appearance import Appearance
from motion_detect_ros.core.tracking.detected_time import DetectedTime
from motion_detect_ros.core.tracking.motion_filter import MotionFilter
from motion_detect_ros.core.tracking.time_to_contact import Approach
from motion_detect_ros.core.tracking.travel import Travel

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

#: The warp of a camera that does not move.
AT_REST: Rows = [[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]]


class Track:
    """One object over time; times are seconds, lengths full-resolution pixels."""

    def __init__(self, seen: Candidate, dt_s: float) -> None:
        """dt_s: period of the frame it was seen in, seconds."""
        self.id = 0
        centre, self.size = pair(seen.centre), pair(seen.size)
        self._filter = MotionFilter(centre, pair(seen.velocity_px_s), self._noise())
        self.seen = seen
        self.age = 1
        self.coasted_s, self.coasted_frames = 0.0, 0
        self.detected = DetectedTime(dt_s, seen.measured)
        self.log_odds = _weight(dt_s) * seen.log_odds
        self.travelled_log_odds = 0.0
        self._travel = Travel(centre)
        self.gate_inflation_px = 0.0
        self.approach = Approach()
        self.approach.update(seen.growth)
        self.appearance: Appearance | None = None
        self.recognised_s = 0.0
        self._log_odds_seen = self.log_odds

    def _noise(self) -> float:
        return max(MIN_CENTRE_PX, CENTRE_SHARE * math.sqrt(self.size[0] * self.size[1])) ** 2

    @property
    def centre(self) -> Pair:
        """u, v, pixels."""
        return self._filter.centre

    @property
    def velocity(self) -> Pair:
        """du/dt, dv/dt against the background, pixels/s."""
        return self._filter.velocity

    @property
    def belief(self) -> float:
        """Log odds of the frames and of the way together."""
        return self.log_odds + self.travelled_log_odds

    def weigh_travel(self) -> bool:
        """What the way since the start tells, unless it has stopped; returns whether it tells anything."""
        self.travelled_log_odds = 0.0 if self.recognised_s else self._travel.log_odds(self.centre, self.size)
        return self.travelled_log_odds > 0.0

    @property
    def velocity_variance(self) -> Pair:
        """Variance of the velocity along both axes, (pixels/s)^2, corrected by what was measured."""
        return self._filter.velocity_variance

    def inside(self, width: int, height: int) -> bool:
        """Whether the centre is on an image of ``width`` x ``height`` pixels."""
        u, v = self.centre
        return 0.0 <= u < width and 0.0 <= v < height

    def covers(self, centre: Pair) -> bool:
        """Whether a place, pixels, is in its box."""
        (u, v), (width, height) = self.centre, self.size
        return abs(u - centre[0]) < 0.5 * width and abs(v - centre[1]) < 0.5 * height

    def predict(self, rows: Rows, dt_s: float) -> None:
        """Carry state, covariance and size over ``dt_s`` seconds: ego-motion of the position, then own velocity.

        rows: of the warp previous pixel -> current pixel, full resolution.
        """
        self.approach.predict(dt_s)
        scale = length_scale(rows, self.centre)
        self.size = self.size[0] * scale, self.size[1] * scale
        side = max(MIN_ACCELERATION_PX, math.sqrt(self.size[0] * self.size[1]))
        self._filter.predict(rows, dt_s, ACCELERATION_SHARE * side)
        self._travel.predict(rows, dt_s)

    def predict_without_ego_motion(self, camera_px: float, dt_s: float) -> None:
        """The same with the camera's motion unknown: none is assumed, ``camera_px`` is its deviation along an axis."""
        self.predict(AT_REST, dt_s)
        self._filter.widen(camera_px ** 2)
        self.gate_inflation_px = math.hypot(self.gate_inflation_px, camera_px)

    def update(self, seen: Candidate, dt_s: float) -> None:
        """Correct with a detection's centre and flow velocity (Kalman 1960); sizes are averaged, log odds add up."""
        self._found_at(pair(seen.centre))
        self._filter.correct(pair(seen.centre), pair(seen.velocity_px_s), self._noise())
        (width, height), (seen_width, seen_height) = self.size, pair(seen.size)
        self.size = _averaged(width, seen_width), _averaged(height, seen_height)
        self._add_log_odds(seen.log_odds, _weight(dt_s), dt_s)
        self.approach.update(seen.growth)
        self.seen = seen
        self.coasted_s, self.coasted_frames = 0.0, 0
        self.recognised_s = 0.0
        self._log_odds_seen = self.log_odds

    def coast_missed(self, dt_s: float) -> None:
        """A frame without a detection of the object."""
        self._add_log_odds(MISS_LOG_ODDS, min(1.0, _weight(dt_s)), dt_s)  # one miss, however long the period
        self._coast(dt_s)

    def coast_recognised(self, centre: Pair, dt_s: float, appearance_hold_s: float) -> None:
        """The object shows no motion but was recognised at ``centre``: log odds fall by their amount over
        ``appearance_hold_s``, positive ones to 0.

        centre: full-resolution pixels; dt_s: since the last frame, seconds; appearance_hold_s: over 0, seconds.
        """
        self.recognised_s += dt_s
        self._found_at(centre)
        self._filter.correct_place(centre, MIN_CENTRE_PX ** 2)
        self._filter.slow(kept(dt_s, REST_S))
        self.log_odds = self._log_odds_seen - abs(self._log_odds_seen) * min(1.0, self.recognised_s / appearance_hold_s)
        self.coasted_s, self.coasted_frames = 0.0, 0

    def coast_unobserved(self, dt_s: float) -> None:
        """A frame in which detection was impossible: the log odds decay, nothing is added."""
        self._add_log_odds(0.0, 0.0, dt_s)
        self._coast(dt_s)

    def coasted_no_longer_than(self, seconds: float) -> bool:
        """Up to jitter of the period; one frame is always allowed unless none is (0 s)."""
        if not self.coasted_frames:
            return True
        period_s = self.coasted_s / self.coasted_frames
        return seconds > 0.0 and (
            self.coasted_frames == 1 or not exceeded(self.coasted_s, seconds, period_s))

    def _found_at(self, centre: Pair) -> None:
        """It is at ``centre`` now; after a time without ego-motion what that is off is the camera's way."""
        if self.gate_inflation_px:
            self._travel.jump((centre[0] - self.centre[0], centre[1] - self.centre[1]))
        self.gate_inflation_px = 0.0

    def _coast(self, dt_s: float) -> None:
        self.coasted_s += dt_s
        self.coasted_frames += 1

    def _add_log_odds(self, log_odds: float, weight: float, dt_s: float) -> None:
        before = kept(dt_s, LOG_ODDS_MEMORY_S) * self.log_odds
        self.log_odds = min(MAX_LOG_ODDS, before + weight * log_odds)


def _averaged(side: float, seen: float) -> float:
    mismatch = math.log(seen / side)
    return side + SIZE_GAIN / (1.0 + mismatch * mismatch) * (seen - side)


def _weight(dt_s: float) -> float:
    """Weight of the log odds of a frame of this period: the sum has the same limit at every frame rate."""
    return (1.0 - kept(dt_s, LOG_ODDS_MEMORY_S)) / (1.0 - kept(PERIOD_S, LOG_ODDS_MEMORY_S))
