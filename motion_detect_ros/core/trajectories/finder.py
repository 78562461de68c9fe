"""From frames to candidates of small and slow objects: points, their motion, clusters, boxes."""

from __future__ import annotations

import numpy as np

from motion_detect_ros.core.config import PipelineConfig
from motion_detect_ros.core.detection.candidate import Candidate
from motion_detect_ros.core.trajectories.clusters import Cluster, find_clusters
from motion_detect_ros.core.trajectories.object_motion import PointMotion, object_motion
from motion_detect_ros.core.trajectories.point_boxes import BoxFitter, NearestPoints, PointBox
from motion_detect_ros.core.trajectories.point_scoring import point_log_odds
from motion_detect_ros.core.trajectories.points import Points, PointTracker
from motion_detect_ros.core.trajectories.recent_frames import RecentFrames
from motion_detect_ros.core.types import BoolArray, CameraModel, EgoMotion, PreparedFrame

#: Points younger than this do not tell whether they stand still, seconds.
STILL_S = 0.2
#: How far around a box the points are looked at, pixels.
AROUND_PX = 10.0
#: ``Candidate.cluster`` of what no ART2 neuron won.
NO_NEURON = 0


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
        owner = np.full(len(points), -1, np.intp)
        for number, cluster in enumerate(clusters):
            owner[cluster.members] = number
        nearest = NearestPoints(points.now[old], owner[old], frame.gray.shape)
        fitter = BoxFitter(points, self._frames, frame.mask, nearest, self._config)
        boxes = [fitter.fit(cluster, number) for number, cluster in enumerate(clusters)]
        return [_candidate(cluster, box, points, motion, old, frame)
                for cluster, box in zip(clusters, boxes, strict=True)
                if box is not None and min(box.high - box.low) >= self._config.min_side_px]


def _candidate(
    cluster: Cluster, box: PointBox, points: Points, motion: PointMotion, old: BoolArray, frame: PreparedFrame,
) -> Candidate:
    inside = old & _within(points, box, 0.0)
    around = old & _within(points, box, AROUND_PX) & ~inside
    odds = point_log_odds(len(cluster.members), _share(motion.moving, inside), _share(motion.moving, around))
    return Candidate((box.low + box.high) / (2.0 * frame.scale), (box.high - box.low) / frame.scale,
                     cluster.velocity / frame.scale, box.pixels / frame.scale ** 2, odds, NO_NEURON)


def _within(points: Points, box: PointBox, margin_px: float) -> BoolArray:
    """(N,) whether each is in the box; 0.5: from edges to centres of pixels."""
    low, high = box.low - 0.5 - margin_px, box.high - 0.5 + margin_px
    inside: BoolArray = np.all((points.now >= low) & (points.now <= high), axis=1)
    return inside


def _share(moving: BoolArray, chosen: BoolArray) -> float:
    return float((moving & chosen).sum() / max(1, chosen.sum()))
