"""Tracking: ids, velocity against the background, confirmation.

Positions are predicted through the ego-motion, so a constant-velocity Kalman filter sees only the object's own
motion however the camera shakes.
"""

from __future__ import annotations

import math

import numpy as np
from scipy.optimize import linear_sum_assignment

from motion_detect_ros.core.config import TracksConfig
from motion_detect_ros.core.detection.candidate import Candidate
from motion_detect_ros.core.forgetting import kept
from motion_detect_ros.core.geometry.vectors import pair
from motion_detect_ros.core.tracking.alternatives.appearance import APPEARANCE_MODELS
from motion_detect_ros.core.tracking.lost_tracks import LostTracks
from motion_detect_ros.core.tracking.nested import known_longest
from motion_detect_ros.core.tracking.report import reported
from motion_detect_ros.core.tracking.track import Track
from motion_detect_ros.core.tracking.travel import Others
from motion_detect_ros.core.types import MAX_ID, ByteArray, DoubleArray, RecordArray

#: Cost of a pair outside of the gate.
FORBIDDEN = 1e6
#: A detection is looked for within this share of both sizes, and so many pixels, of the prediction; its area may differ
#: by this factor's logarithm (e^1.6 = 5), which costs this share of the gate.
GATE_SHARE, GATE_PX, MAX_LOG_AREA_RATIO, AREA_WEIGHT = 0.3, 3.0, 1.6, 0.25
#: Least deviation of the unknown motion of the image, image widths per second.
CAMERA_WIDTHS_PER_S = 0.25
#: Time constant of the camera's speed, seconds.
CAMERA_SPEED_MEMORY_S = 0.4
#: Gate inflation of a track predicted without ego-motion, deviations of its position.
GATE_INFLATION_DEVIATIONS = 2.0
#: Largest differences of centre and size to the track's at which a box shows the whole object.
SETTLED_SHARE, SETTLED_PX, SETTLED_LOG_SIZE = 0.1, 1.0, 0.25


class Tracker:
    """Assigns candidates to tracks, confirms, and reports the confirmed ones."""

    def __init__(self, config: TracksConfig, first_id: int = 1) -> None:
        """first_id: of the first confirmed track, 1 to MAX_ID; after that comes 1 again."""
        self.use_config(config)
        self._tracks: list[Track] = []
        self._lost = LostTracks()
        self._next_id = first_id
        self._camera_px_s, self._period_s = 0.0, math.inf

    def use_config(self, config: TracksConfig) -> None:
        """Settings from the next frame on, for the tracks that there are too."""
        self._config = config
        self._learn = APPEARANCE_MODELS.get(config.appearance) if config.appearance_hold_s > 0.0 else None

    def reset(self) -> None:
        """Clear all tracks; ids go on counting."""
        self._tracks.clear()
        self._lost.reset()
        self._camera_px_s, self._period_s = 0.0, math.inf

    def step(
        self, candidates: list[Candidate], matrix: DoubleArray, dt_s: float, width: int, height: int,
        gray: ByteArray | None = None,
    ) -> RecordArray:
        """One frame of ``width`` x ``height`` pixels: predict, assign, update.

        matrix: (3, 3) previous pixel -> current pixel; dt_s: time between them, seconds, of which no more than the last
        one, if there was one, speaks for what is new, as it was not seen before; gray: (h, w) uint8, the frame
        at working resolution, for the appearance models. Returns the confirmed objects
        (``DETECTION_DTYPE``), boxes cut to the image; a track ends when its centre leaves the image.
        """
        self._predict(matrix, dt_s, width, height)
        pairs = self._assign(candidates)
        for index, track in enumerate(self._tracks):
            hit = index in pairs
            track.detected.add(dt_s, self._config.confirm_window_s, hit, hit and candidates[pairs[index]].measured)
            if hit:
                track.update(candidates[pairs[index]], dt_s)
                self._remember(track, gray, width)
        for index, track in enumerate(self._tracks):
            if index not in pairs and not self._recognise(track, gray, dt_s, width):
                track.coast_missed(dt_s)
        taken = set(pairs.values())
        for index, seen in enumerate(candidates):
            if index not in taken:
                self._tracks.append(Track(seen, min(dt_s, self._period_s)))
        self._period_s = dt_s
        self._weigh_travel()
        self._confirm()
        self._drop_ended(width, height)
        return self._report(width, height)

    def coast(self, matrix: DoubleArray, dt_s: float, width: int, height: int) -> None:
        """A frame in which detection was impossible: tracks are predicted, and end as if they were missed.

        matrix: as in ``step``.
        """
        self._predict(matrix, dt_s, width, height)
        self._coast_unobserved(dt_s)
        self._drop_ended(width, height)

    def coast_without_frame(self, dt_s: float, width: int) -> None:
        """Predict over a missing frame, in which nothing was detected either: constant velocity, unknown camera motion.
        What was lost before is forgotten.
        """
        camera_px = max(self._camera_px_s, CAMERA_WIDTHS_PER_S * width) * dt_s
        self._lost.reset()
        for track in self._tracks:
            track.predict_without_ego_motion(camera_px, dt_s)
        self._coast_unobserved(dt_s)

    def _coast_unobserved(self, dt_s: float) -> None:
        for track in self._tracks:
            track.coast_unobserved(dt_s)
            track.detected.add(dt_s, self._config.confirm_window_s, False)

    def _remember(self, track: Track, gray: ByteArray | None, width: int) -> None:
        """Learn an object's appearance while its box shows the whole object."""
        if self._learn is None or gray is None or not track.id:
            return
        centre, size = np.array(track.centre), np.array(track.size)
        off = np.abs(track.seen.centre - centre) - SETTLED_SHARE * size
        if (off < SETTLED_PX).all() and (np.abs(np.log(track.seen.size / size)) < SETTLED_LOG_SIZE).all():
            scale = gray.shape[1] / width
            learnt = self._learn(gray, centre * scale, size * scale)
            track.appearance = learnt or track.appearance

    def _recognise(self, track: Track, gray: ByteArray | None, dt_s: float, width: int) -> bool:
        """Whether a confirmed track without a detection was recognised by its appearance."""
        if gray is None or track.appearance is None or track.recognised_s + dt_s > self._config.appearance_hold_s:
            return False
        if any(other is not track and other.id and not other.coasted_s and not other.recognised_s
               and other.covers(track.centre) for other in self._tracks):
            return False  # another track has been detected there
        scale = gray.shape[1] / width
        found = track.appearance.find(gray, np.array(track.centre) * scale, np.array(track.size) * scale)
        if found is None:
            return False
        track.coast_recognised(pair(found / scale), dt_s, self._config.appearance_hold_s)
        return True

    def _predict(self, matrix: DoubleArray, dt_s: float, width: int, height: int) -> None:
        centre = np.array([width / 2.0, height / 2.0, 1.0])
        moved = matrix @ centre
        speed_px_s = float(np.hypot(*(moved[:2] / moved[2] - centre[:2]))) / max(dt_s, 1e-6)
        self._camera_px_s = max(speed_px_s, kept(dt_s, CAMERA_SPEED_MEMORY_S) * self._camera_px_s)
        rows = matrix.tolist()

        def move(track: Track) -> None:
            track.predict(rows, dt_s)
            track.age += 1

        for track in self._tracks:
            move(track)
        self._lost.carry(move, dt_s, width, height)

    def _assign(self, candidates: list[Candidate]) -> dict[int, int]:
        """Track index -> candidate index, least total cost (Kuhn 1955), gated."""
        if not self._tracks or not candidates:
            return {}
        cost = self._cost(candidates)
        rows, columns = linear_sum_assignment(cost)
        return {int(r): int(c) for r, c in zip(rows, columns, strict=True) if cost[r, c] < FORBIDDEN}

    def _cost(self, candidates: list[Candidate]) -> DoubleArray:
        """(tracks, candidates) distance in units of both sizes, plus a share of the log ratio of their areas."""
        places = np.array([track.centre for track in self._tracks])
        sizes = np.array([track.size for track in self._tracks])
        inflation_px = GATE_INFLATION_DEVIATIONS * np.array([track.gate_inflation_px for track in self._tracks])
        seen_places, seen_sizes = np.array([seen.centre for seen in candidates]), np.array([s.size for s in candidates])
        offsets, reaches = [], []
        for axis in (0, 1):
            offsets.append(seen_places[:, axis] - places[:, axis, None])
            reaches.append(GATE_SHARE * (sizes[:, axis, None] + seen_sizes[:, axis]) + GATE_PX + inflation_px[:, None])
        # few pairs are near: what all pairs need is kept short
        near = np.nonzero((np.abs(offsets[0]) < reaches[0]) & (np.abs(offsets[1]) < reaches[1]))
        distance = np.hypot(offsets[0][near] / reaches[0][near], offsets[1][near] / reaches[1][near])
        ratio = np.abs(np.log(seen_sizes.prod(axis=1)[near[1]] / sizes.prod(axis=1)[near[0]]))
        cost = np.full((len(places), len(seen_places)), FORBIDDEN)
        cost[near] = np.where(
            (distance < 1.0) & (ratio < MAX_LOG_AREA_RATIO), distance + AREA_WEIGHT * ratio, FORBIDDEN)
        return cost

    def _weigh_travel(self) -> None:
        certain = [track for track in self._tracks if track.id and track.log_odds >= self._config.show_log_odds]
        others = Others([track.centre for track in certain], [track.size for track in certain])
        far = [track for track in self._tracks if track.weigh_travel()]
        beside = others.hold_larger([track.centre for track in far], [track.size for track in far])
        for index in np.flatnonzero(beside):
            far[index].travelled_log_odds = 0.0

    def _confirm(self) -> None:
        confirmed = [track for track in self._tracks
                     if track.id == 0 and track.belief >= self._config.confirm_log_odds
                     and track.detected.for_at_least(self._config.confirm_s)]
        for track, lost in zip(confirmed, self._lost.found_again(confirmed), strict=True):
            if lost is not None:
                track.id, track.age = lost.id, lost.age
                continue
            track.id = self._next_id
            self._next_id = self._next_id % MAX_ID + 1

    def _drop_ended(self, width: int, height: int) -> None:
        tracks, self._tracks = self._tracks, []
        for track in tracks:
            if not track.inside(width, height):
                continue
            if self._alive(track):
                self._tracks.append(track)
            elif track.id:
                self._lost.add(track)

    def _alive(self, track: Track) -> bool:
        if track.id:
            return track.coasted_no_longer_than(self._config.coast_s)
        return not track.detected.missed_longer_than(self._config.confirm_window_s - self._config.confirm_s)

    def _report(self, width: int, height: int) -> RecordArray:
        shown = known_longest(
            [track for track in self._tracks if track.id and track.belief >= self._config.show_log_odds])
        return reported(shown, width, height)
