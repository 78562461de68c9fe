"""From frames to candidates of small and slow objects: points, their motion, clusters, boxes."""

from __future__ import annotations

import cv2
import numpy as np

from motion_detect_ros.core.config import PipelineConfig
from motion_detect_ros.core.detection.candidate import Candidate
from motion_detect_ros.core.trajectories.clusters import Cluster, find_clusters
from motion_detect_ros.core.trajectories.object_motion import PointMotion, object_motion
from motion_detect_ros.core.trajectories.point_boxes import BoxFitter, NearestPoints, PointBox
from motion_detect_ros.core.trajectories.point_scoring import point_log_odds
from motion_detect_ros.core.trajectories.points import Points, PointTracker
from motion_detect_ros.core.trajectories.recent_frames import RecentFrames
from motion_detect_ros.core.types import BoolArray, CameraModel, EgoMotion, FloatArray, PreparedFrame

#: Points younger than this do not tell whether they stand still, seconds.
STILL_S = 0.2
#: Candidates with lower log odds are dropped; so low with the bounds of the points, no box is fitted.
LEAST_LOG_ODDS, FITTED_LOG_ODDS = -2.0, -2.5
#: How far around a box the points are looked at, pixels.
AROUND_PX = 10.0
#: ``Candidate.cluster`` of what no ART2 neuron won.
NO_NEURON = 0


class PointCounts:
    """How many points there are in a box, from their summed-area table (Crow 1984)."""

    def __init__(self, places: FloatArray, shape: tuple[int, ...]) -> None:
        """places: (N, 2) pixels; shape: (h, w)."""
        there = np.zeros(shape, np.uint8)
        columns, rows = np.rint(places).astype(np.intp).T
        there[rows, columns] = 1
        self._sums = cv2.integral(there)

    def within(self, box: PointBox, margin_px: float) -> int:
        """In the box grown by a margin; two in the same pixel are one."""
        height, width = self._sums.shape
        left, top = np.clip(np.rint(box.low - margin_px), 0, [width - 1, height - 1]).astype(int).tolist()
        right, bottom = np.clip(np.rint(box.high + margin_px), 0, [width - 1, height - 1]).astype(int).tolist()
        sums = self._sums
        return int(sums[bottom, right] - sums[top, right] - sums[bottom, left] + sums[top, left])


class TrajectoryFinder:
    """Holds the points and the frames of the last second."""

    def __init__(self, config: PipelineConfig) -> None:
        self._config = config.objects
        self._frames = RecentFrames()
        self._tracker = PointTracker(config.trajectories.max_points)

    def reset(self) -> None:
        """Clear frames and points."""
        self._frames.reset()
        self._tracker.reset()

    def candidates(self, frame: PreparedFrame, ego: EgoMotion, camera: CameraModel) -> list[Candidate]:
        """Objects in ``frame``; ego: motion into it; camera: of its working resolution."""
        if not self._frames.add(frame, ego):
            self._tracker.reset()
        points = self._tracker.step(self._frames, frame.mask)
        if len(self._frames) < 2:
            return []
        motion = object_motion(points, self._frames, camera)
        old = points.age >= self._frames.nearest(STILL_S)
        clusters = find_clusters(points, motion, old, self._frames)
        return self._boxed(clusters, points, motion, old, frame) if clusters else []

    def _boxed(
        self, clusters: list[Cluster], points: Points, motion: PointMotion, old: BoolArray, frame: PreparedFrame,
    ) -> list[Candidate]:
        known = PointCounts(points.now[old], frame.gray.shape)
        moving = PointCounts(points.now[old & motion.moving], frame.gray.shape)
        owner = np.full(len(points), -1, np.intp)
        for number, cluster in enumerate(clusters):
            owner[cluster.members] = number
        fitter = BoxFitter(points, self._frames, frame.mask, NearestPoints(points.now[old], owner[old]), self._config)
        found = []
        for number, cluster in enumerate(clusters):
            bounds = PointBox.around(cluster)
            if _log_odds(cluster, bounds, known, moving) < FITTED_LOG_ODDS:
                continue
            box = fitter.fit(cluster, number)
            if box is not None and min(box.high - box.low) >= self._config.min_side_px:
                found.append(_candidate(cluster, box, _log_odds(cluster, box, known, moving), frame.scale))
        return [candidate for candidate in found if candidate.log_odds >= LEAST_LOG_ODDS]


def _candidate(cluster: Cluster, box: PointBox, log_odds: float, scale: float) -> Candidate:
    return Candidate((box.low + box.high) / (2.0 * scale), (box.high - box.low) / scale, cluster.velocity / scale,
                     box.pixels / scale ** 2, log_odds, NO_NEURON)


def _log_odds(cluster: Cluster, box: PointBox, known: PointCounts, moving: PointCounts) -> float:
    inside, wide = known.within(box, 0.0), known.within(box, AROUND_PX)
    moving_inside, moving_wide = moving.within(box, 0.0), moving.within(box, AROUND_PX)
    return point_log_odds(len(cluster.members), moving_inside / max(1, inside),
                          (moving_wide - moving_inside) / max(1, wide - inside))
