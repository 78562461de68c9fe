"""Objects over time: ids, velocity without the camera's motion, confirmation.

Positions are predicted through the ego-motion, so a constant-velocity Kalman filter sees only the object's own
motion however the camera shakes.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.optimize import linear_sum_assignment

from motion_detect_ros.core.config import TracksConfig
from motion_detect_ros.core.scoring import probability
from motion_detect_ros.core.types import DoubleArray, RecordArray, empty_detections

#: Cost that forbids a pairing.
FORBIDDEN = 1e6
#: Measurement noise of a box centre, share of the box's side; and process noise of the velocity, shares per second.
CENTRE_SHARE = 0.12
ACCELERATION_SHARE = 2.0
MIN_CENTRE_PX = 1.0
#: What a track keeps of its evidence from frame to frame, what a miss costs, and where evidence saturates.
KEPT_ODDS = 0.8
MISS_LOG_ODDS = 1.0
MAX_LOG_ODDS = 10.0
#: Weight of a new size against the remembered one.
SIZE_GAIN = 0.4


@dataclass(frozen=True)
class Candidate:
    """One object seen in one frame. ``centre``, ``size``, ``velocity_px_s``: (2,) full-resolution pixels.

    ``log_odds``: how sure this frame alone is that it moves, see ``core.scoring``.
    """

    centre: DoubleArray
    size: DoubleArray
    velocity_px_s: DoubleArray
    area: float
    log_odds: float
    cluster: int


class Track:
    """One object's filter: state (u, v, du/dt, dv/dt), pixels and pixels/s, background-fixed velocity."""

    def __init__(self, number: int, seen: Candidate) -> None:
        self.number = number
        self.id = 0
        self.state: DoubleArray = np.r_[seen.centre, seen.velocity_px_s]
        noise = self._noise(seen.size)
        self.covariance: DoubleArray = np.diag(np.r_[noise, noise, 16.0 * noise, 16.0 * noise])
        self.size = seen.size
        self.seen = seen
        self.age = 1
        self.missed = 0
        self.hits: list[bool] = [True]
        self.log_odds = seen.log_odds

    @staticmethod
    def _noise(size: DoubleArray) -> float:
        return max(MIN_CENTRE_PX, CENTRE_SHARE * float(np.sqrt(size[0] * size[1]))) ** 2

    def inside(self, width: int, height: int) -> bool:
        """Whether the centre is on an image of ``width`` x ``height`` pixels."""
        return bool(0.0 <= self.state[0] <= width - 1 and 0.0 <= self.state[1] <= height - 1)

    def visible(self, width: int, height: int) -> tuple[DoubleArray, DoubleArray]:
        """Centre and size of the part of the box that is on the image, (2,) each; edges at pixel borders."""
        low = np.maximum(self.state[:2] - self.size / 2.0, 0.0)
        high = np.minimum(self.state[:2] + self.size / 2.0, [width, height])
        return (low + high) / 2.0, high - low

    def predict(self, matrix: DoubleArray, dt_s: float) -> None:
        """Carry the state into the next frame: ego-motion of the position, then own velocity."""
        x, y, vx, vy = self.state
        moved = matrix @ [x, y, 1.0]
        moved = moved[:2] / moved[2]
        linear = matrix[:2, :2]
        scale = float(np.sqrt(abs(np.linalg.det(linear))))
        velocity = linear @ [vx, vy]
        self.state = np.r_[moved + velocity * dt_s, velocity]
        self.size = self.size * scale
        step = np.eye(4)
        step[0, 2] = step[1, 3] = dt_s
        acceleration = ACCELERATION_SHARE * max(8.0, float(np.sqrt(self.size[0] * self.size[1])))
        ramp = np.array([[dt_s ** 2 / 2.0, 0.0], [0.0, dt_s ** 2 / 2.0], [dt_s, 0.0], [0.0, dt_s]]) * acceleration
        self.covariance = step @ self.covariance @ step.T + ramp @ ramp.T
        self.age += 1

    def update(self, seen: Candidate) -> None:
        """Correct with a detection's centre and flow velocity; sizes are averaged."""
        position = self._noise(self.size)
        noise = np.diag([position, position, 36.0 * position, 36.0 * position])
        gain = np.linalg.solve(self.covariance + noise, self.covariance).T
        self.state = self.state + gain @ (np.r_[seen.centre, seen.velocity_px_s] - self.state)
        self.covariance = self.covariance - gain @ self.covariance
        self.size = self.size + SIZE_GAIN * (seen.size - self.size)
        self.log_odds = min(MAX_LOG_ODDS, KEPT_ODDS * self.log_odds + seen.log_odds)
        self.seen = seen
        self.missed = 0

    def miss(self) -> None:
        """Nothing was found where the object should be."""
        self.log_odds = KEPT_ODDS * self.log_odds - MISS_LOG_ODDS
        self.missed += 1


class Tracker:
    """Assigns candidates to tracks, confirms, and reports the confirmed ones."""

    def __init__(self, config: TracksConfig) -> None:
        self._config = config
        self._tracks: list[Track] = []
        self._started = 0
        self._confirmed = 0

    def reset(self) -> None:
        """Forget all tracks; ids go on counting."""
        self._tracks.clear()

    def step(
        self, candidates: list[Candidate], matrix: DoubleArray, dt_s: float, width: int, height: int,
    ) -> RecordArray:
        """One frame of ``width`` x ``height`` pixels: predict, assign, update.

        matrix: (3, 3) previous pixel -> current pixel. Returns the confirmed objects (``DETECTION_DTYPE``), boxes cut
        to the image; a track whose centre has left the image is over.
        """
        for track in self._tracks:
            track.predict(matrix, dt_s)
        pairs = self._assign(candidates)
        for index, track in enumerate(self._tracks):
            hit = index in pairs
            track.hits = [*track.hits, hit][-self._config.confirm_frames:]
            if hit:
                track.update(candidates[pairs[index]])
            else:
                track.miss()
        taken = set(pairs.values())
        for index, seen in enumerate(candidates):
            if index not in taken:
                self._started += 1
                self._tracks.append(Track(self._started, seen))
        self._confirm()
        self._tracks = [track for track in self._tracks if self._alive(track) and track.inside(width, height)]
        return self._report(width, height)

    def skip(self) -> None:
        """A frame without ego-motion: nobody knows where the objects went; every track misses once."""
        for track in self._tracks:
            track.miss()
            track.hits = [*track.hits, False][-self._config.confirm_frames:]
        self._tracks = [track for track in self._tracks if self._alive(track)]

    def _assign(self, candidates: list[Candidate]) -> dict[int, int]:
        """Track index -> candidate index, least total cost (Kuhn 1955), gated."""
        if not self._tracks or not candidates:
            return {}
        cost = np.array([[self._cost(track, seen) for seen in candidates] for track in self._tracks])
        rows, columns = linear_sum_assignment(cost)
        return {int(r): int(c) for r, c in zip(rows, columns, strict=True) if cost[r, c] < FORBIDDEN}

    def _cost(self, track: Track, seen: Candidate) -> float:
        offset = seen.centre - track.state[:2]
        reach = 0.5 * (track.size + seen.size) * 0.6 + 3.0
        distance = float(np.hypot(*(offset / reach)))
        ratio = abs(float(np.log(seen.size.prod() / track.size.prod())))
        return distance + 0.25 * ratio if distance < 1.0 and ratio < 1.6 else FORBIDDEN

    def _confirm(self) -> None:
        for track in self._tracks:
            enough = sum(track.hits) >= self._config.confirm_hits and track.log_odds >= self._config.confirm_log_odds
            if track.id == 0 and enough:
                self._confirmed += 1
                track.id = self._confirmed

    def _alive(self, track: Track) -> bool:
        if track.id:
            return track.missed <= self._config.coast_frames
        misses = len(track.hits) - sum(track.hits)
        return misses <= self._config.confirm_frames - self._config.confirm_hits

    def _report(self, width: int, height: int) -> RecordArray:
        shown = [track for track in self._tracks if track.id and track.log_odds >= self._config.show_log_odds]
        records = empty_detections(len(shown))
        for record, track in zip(records, shown, strict=True):
            (record['u'], record['v']), (record['width'], record['height']) = track.visible(width, height)
            record['vel_u'], record['vel_v'] = track.state[2:]
            record['var_u'], record['var_v'] = track.covariance[2, 2], track.covariance[3, 3]
            record['score'] = probability(track.log_odds)
            record['id'], record['age'], record['area'] = track.id, track.age, track.seen.area
            record['cluster'] = track.seen.cluster
        return records
