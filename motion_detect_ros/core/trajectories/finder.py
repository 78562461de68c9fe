"""From frames to candidates of small and slow objects: points, their motion, clusters, boxes."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import cv2
import numpy as np
import numpy.typing as npt

from motion_detect_ros.core.config import PipelineConfig
from motion_detect_ros.core.detection.candidate import Candidate
from motion_detect_ros.core.geometry.boxes import Box
from motion_detect_ros.core.geometry.order_statistics import column_medians
from motion_detect_ros.core.periods import Every, reached
from motion_detect_ros.core.trajectories.clusters import MIN_POINTS, Cluster, find_clusters
from motion_detect_ros.core.trajectories.object_motion import object_motion
from motion_detect_ros.core.trajectories.point_boxes import BoxFitter, NearestPoints, PointBox
from motion_detect_ros.core.trajectories.point_scoring import POINT_SCORE, ClusterFigures, PointScore
from motion_detect_ros.core.trajectories.points import Points, PointTracker
from motion_detect_ros.core.trajectories.recent_frames import RecentFrames
from motion_detect_ros.core.trajectories.soft_shadows import SoftShadows
from motion_detect_ros.core.trajectories.spare_points import spare_points
from motion_detect_ros.core.trajectories.standing import StandingPoints
from motion_detect_ros.core.types import BoolArray, CameraModel, DoubleArray, EgoMotion, FloatArray, PreparedFrame

#: Objects are found so often, seconds; in between they go where their points go. In the third frame first, so that
#: flow measured as often, in the second frame first, comes in other frames.
FOUND_EVERY_S, FIRST_FRAMES = 0.1, 3
#: Points younger than this do not tell whether they stand still, seconds.
STILL_S = 0.2
#: With so much lower log odds than the least, taken with the bounds of the points, no box is fitted.
UNFITTED_LOG_ODDS = 0.5
#: How far around a box the points are looked at, pixels.
AROUND_PX = 10.0
#: Boxes are fitted a frame after their clusters are found where finding comes later than so many frames after that.
FRAMES_TAKEN = 2
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

    def within(self, low: DoubleArray, high: DoubleArray, margin_px: float) -> npt.NDArray[np.int32]:
        """(K,) in boxes grown by a margin; two in the same pixel are one. low, high: (K, 2) pixels."""
        sums = self._sums
        height, width = sums.shape
        left, top = np.maximum(np.rint(low - margin_px), 0.0).astype(np.intp).T
        right, bottom = np.minimum(np.rint(high + margin_px), [width - 1, height - 1]).astype(np.intp).T
        counts: npt.NDArray[np.int32] = sums[bottom, right] - sums[top, right] - sums[bottom, left] + sums[top, left]
        return counts


@dataclass(frozen=True)
class FoundObject:
    """Box in working-resolution pixels; the figures and the log odds are those of the frame it was found in."""

    cluster: Cluster
    box: PointBox
    figures: ClusterFigures
    log_odds: float

    def moved(self, before: Points, now: Points) -> FoundObject | None:
        """Where the points that live on have gone; None where too few do."""
        was, there = now.survivors(before, self.cluster.members)
        if len(there) < MIN_POINTS:
            return None
        way = column_medians(now.now[there] - before.now[was])
        return replace(self, cluster=self.cluster.at(there, now.now),
                       box=PointBox(self.box.low + way, self.box.high + way, self.box.pixels))

    def candidate(self, scale: float) -> Candidate:
        """scale: working pixels per full-resolution pixel."""
        low, high = self.box.low / scale, self.box.high / scale
        return Candidate((low + high) / 2.0, high - low, self.cluster.velocity / scale, self.box.pixels / scale ** 2,
                         self.log_odds, NO_NEURON)


@dataclass(frozen=True)
class _Clusters:
    """Clusters of one frame. ``points``: of it; ``known``, ``moving``: which of these are old enough to show
    motion, and do.
    """

    clusters: list[Cluster]
    points: Points
    known: npt.NDArray[np.intp]
    moving: npt.NDArray[np.intp]

    def among(self, now: Points) -> _Clusters:
        """The same in a later frame, with the points that live on, and without clusters of too few."""
        there = (now.survivors(self.points, cluster.members)[1] for cluster in self.clusters)
        clusters = [cluster.at(members, now.now) for cluster, members in zip(self.clusters, there, strict=True)
                    if len(members) >= MIN_POINTS]
        known, moving = (now.survivors(self.points, each)[1] for each in (self.known, self.moving))
        return _Clusters(clusters, now, known, moving)


class TrajectoryFinder:
    """Holds the points and the frames of the last second.

    ``objects``: of the last frame; ``found``: whether they were found in it, else they were carried on.
    """

    def __init__(self, config: PipelineConfig, score: PointScore = POINT_SCORE) -> None:
        self._config, self._score = config.objects, score
        self._frames = RecentFrames()
        self._every = Every(FOUND_EVERY_S)
        self._tracker = PointTracker(config.trajectories.max_points)
        self._start_anew()

    def use_config(self, config: PipelineConfig) -> None:
        """Settings of objects from the next frame on."""
        self._config = config.objects

    def reset(self) -> None:
        """Clear frames and points."""
        self._frames.reset()
        self._start_anew()

    def _start_anew(self) -> None:
        self._tracker.reset()
        self._every.reset()
        self._points, self.objects, self.found = Points(), list[FoundObject](), False
        self._standing = StandingPoints()
        self._waiting: _Clusters | None = None

    def candidates(self, frame: PreparedFrame, ego: EgoMotion, camera: CameraModel) -> list[Candidate]:
        """Objects in ``frame``; ego: motion into it; camera: of its working resolution."""
        if not self._frames.add(frame, ego):
            self._start_anew()
        self._shadows = SoftShadows(self._frames)
        before, self._points = self._points, self._tracker.step(self._frames, frame.mask)
        clusters = None if self._waiting is None else self._waiting.among(self._points)
        self._waiting = None
        if self._every.due(ego.dt_s) and len(self._frames) >= FIRST_FRAMES:
            clusters = self._clusters(camera)
            self._every.done()
            if self.objects and not reached(FRAMES_TAKEN * ego.dt_s, FOUND_EVERY_S, ego.dt_s):
                clusters, self._waiting = None, clusters
        self.found = clusters is not None
        if clusters is not None:
            self.objects = self._boxes(clusters, frame)
        else:
            moved = (each.moved(before, self._points) for each in self.objects)
            self.objects = [each for each in moved if each is not None]
        return [each.candidate(frame.scale) for each in self.objects]

    def without_standing(self, candidates: Sequence[Candidate], scale: float) -> list[Candidate]:
        """Candidates of flow in the frame of the last ``candidates`` less those where the points stand still.

        scale: working pixels per full-resolution pixel.
        """
        denied = self._standing.denied(candidates, self._points, scale)
        return [each for each, still in zip(candidates, denied, strict=True) if not still]

    def without_shadows(self, candidates: Sequence[Candidate], scale: float) -> list[Candidate]:
        """Candidates of flow in the frame of the last ``candidates``, their boxes without soft shadows.

        scale: working pixels per full-resolution pixel.
        """
        height, width = self._frames[0].gray.shape
        return [_without_shadow(each, self._shadows, scale, width, height) for each in candidates]

    def _clusters(self, camera: CameraModel) -> _Clusters:
        points = self._points
        old: BoolArray = points.age >= self._frames.nearest(STILL_S)
        motion = object_motion(points, self._frames, camera)
        self._tracker.told(motion.moving, spare_points(points, motion, self._frames))
        self._standing.measured(points, motion, np.flatnonzero(old))
        return _Clusters(find_clusters(points, motion, old, self._frames), points, np.flatnonzero(old),
                        np.flatnonzero(old & motion.moving))

    def _boxes(self, of: _Clusters, frame: PreparedFrame) -> list[FoundObject]:
        """Those that are objects; of: in ``frame``."""
        clusters, places = of.clusters, of.points.now
        if not clusters:
            return []
        known = PointCounts(places[of.known], frame.gray.shape)
        moving = PointCounts(places[of.moving], frame.gray.shape)
        owner = np.full(len(places), -1, np.intp)
        for number, cluster in enumerate(clusters):
            owner[cluster.members] = number
        fitter = BoxFitter(of.points, self._frames, frame.mask, NearestPoints(places[of.known], owner[of.known]),
                           self._shadows, self._config)
        bounds = _figures(clusters, [PointBox.around(cluster.low, cluster.high) for cluster in clusters], known, moving)
        fitted = [(cluster, fitter.fit(cluster, number)) for number, cluster in enumerate(clusters)
                  if self._score.log_odds(bounds[number]) >= self._score.least - UNFITTED_LOG_ODDS]
        found = [(cluster, box) for cluster, box in fitted
                 if box is not None and min(box.whole.high - box.whole.low) >= self._config.min_side_px]
        if not found:
            return []
        there, boxes = zip(*found, strict=True)
        figures = _figures(there, [box.whole for box in boxes], known, moving)
        objects = (FoundObject(cluster, box.solid, one, self._score.log_odds(one))
                   for (cluster, box), one in zip(found, figures, strict=True))
        return [each for each in objects if each.log_odds >= self._score.least]


def _without_shadow(candidate: Candidate, shadows: SoftShadows, scale: float, width: int, height: int) -> Candidate:
    """width, height: of the working resolution."""
    half = candidate.size / 2.0
    low, high = scale * (candidate.centre - half), scale * (candidate.centre + half)
    region = Box(*np.floor(low).astype(int).tolist(), *np.ceil(high).astype(int).tolist()).grown(0, width, height)
    if region.width <= 0 or region.height <= 0:
        return candidate
    own = np.ones((region.height, region.width), np.bool_)
    speed = scale * float(np.hypot(*candidate.velocity_px_s))
    rows, columns = np.nonzero(~shadows.of(own, region, speed, scale * float(candidate.size.max())))
    low = np.maximum(low, [region.left + columns.min(), region.top + rows.min()]) / scale
    high = np.minimum(high, [region.left + columns.max() + 1, region.top + rows.max() + 1]) / scale
    return replace(candidate, centre=(low + high) / 2.0, size=high - low)


def _figures(
    clusters: Sequence[Cluster], boxes: Sequence[PointBox], known: PointCounts, moving: PointCounts,
) -> list[ClusterFigures]:
    low, high = np.array([box.low for box in boxes]), np.array([box.high for box in boxes])
    inside, moving_inside = known.within(low, high, 0.0), moving.within(low, high, 0.0)
    around = known.within(low, high, AROUND_PX) - inside
    moving_around = moving.within(low, high, AROUND_PX) - moving_inside
    return [ClusterFigures(len(cluster.members), *shares) for cluster, *shares in zip(
        clusters, (moving_inside / np.maximum(1, inside)).tolist(), (moving_around / np.maximum(1, around)).tolist(),
        strict=True)]
