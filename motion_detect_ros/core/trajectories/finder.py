"""From frames to candidates of small and slow objects: points, their motion, clusters, boxes."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import partial

import numpy as np

from motion_detect_ros.core.config import PipelineConfig
from motion_detect_ros.core.deferred import LATER_S, Deferred
from motion_detect_ros.core.detection.candidate import Candidate
from motion_detect_ros.core.detection.several_objects import UsualSize
from motion_detect_ros.core.periods import Every
from motion_detect_ros.core.trajectories.clusters import find_clusters
from motion_detect_ros.core.trajectories.found_objects import ClusteredPoints, FoundObject, moved_on, objects_of
from motion_detect_ros.core.trajectories.hard_shadows import SunSide
from motion_detect_ros.core.trajectories.object_motion import object_motion
from motion_detect_ros.core.trajectories.parted_clusters import LEAST_OBJECTS, seen_area
from motion_detect_ros.core.trajectories.point_scoring import POINT_SCORE, PointScore
from motion_detect_ros.core.trajectories.points import Points, PointTracker
from motion_detect_ros.core.trajectories.recent_frames import RecentFrames
from motion_detect_ros.core.trajectories.soft_shadows import SoftShadows, without_shadow
from motion_detect_ros.core.trajectories.spare_points import spare_points
from motion_detect_ros.core.trajectories.standing import NOT_DENIED_LOG_ODDS, StandingPoints
from motion_detect_ros.core.types import BoolArray, CameraModel, EgoMotion, PreparedFrame, RecordArray

#: Objects are found so often, seconds; in between they go where their points go. In the third frame first, so that
#: flow measured as often, in the second frame first, comes in other frames.
FOUND_EVERY_S, FIRST_FRAMES = 0.1, 3
#: Points younger than this do not tell whether they stand still, seconds.
STILL_S = 0.2

@dataclass(frozen=True)
class _Found:
    """What the points of one frame show. ``points``: new ones included; ``objects``, ``standing``: None where only new
    points were due.
    """

    points: Points
    objects: list[FoundObject] | None = None
    standing: StandingPoints | None = None


class TrajectoryFinder:
    """Holds the points and the frames of the last second.

    The answer of a frame waits for its points, not for what they show: objects are found behind it, from its points and
    images, and go where their points go from the next frame on. ``objects``: in the last frame; ``found``: whether they
    were found anew for it.
    """

    def __init__(self, config: PipelineConfig, score: PointScore = POINT_SCORE) -> None:
        self._config, self._score = config.objects, score
        self._frames = RecentFrames()
        self._every = Every(FOUND_EVERY_S)
        self._tracker = PointTracker(config.trajectories.max_points)
        self._behind = Deferred[_Found]('trajectories')
        self._sun, self._usual = SunSide(), UsualSize(LEAST_OBJECTS)
        self._start_anew()

    def use_config(self, config: PipelineConfig) -> None:
        """Settings of objects from the next frame on."""
        self._behind.wait()
        self._config = config.objects

    def reset(self) -> None:
        """Clear frames and points."""
        self._behind.drop()
        self._frames.reset()
        self._start_anew()

    def wait(self) -> None:
        """Until what is done behind the last frame is done; ``candidates`` does so itself."""
        self._behind.wait()

    def _start_anew(self) -> None:
        self._tracker.reset()
        self._every.reset()
        self._points, self.objects = Points(), list[FoundObject]()
        self.found = self._anew = False
        self._standing = StandingPoints()
        self._sun.reset()
        self._usual.reset()

    def take(self) -> None:
        """Use what was found behind the last frame, which ``candidates`` does too. Raises: what finding it raised."""
        found = self._behind.take()
        if found is not None:
            self._use(found)

    def candidates(self, frame: PreparedFrame, ego: EgoMotion, camera: CameraModel) -> list[Candidate]:
        """Objects in ``frame``; ego: motion into it; camera: of its working resolution."""
        self.take()
        if not self._frames.add(frame, ego):
            self._start_anew()
        self._shadows = SoftShadows(self._frames)
        before, self._points = self._points, self._tracker.track(self._frames, frame.mask)
        self.objects = moved_on(self.objects, before, self._points)
        due = self._every.due(ego.dt_s) and len(self._frames) >= FIRST_FRAMES
        look = partial(self._look, self._frames.copy(), frame.mask, self._shadows, camera if due else None)
        if due:
            self._every.done()
        if due and (not self.objects or ego.dt_s > LATER_S):
            self._use(look())
        elif due or self._tracker.new_due:
            self._behind.start(look)
        self.found, self._anew = self._anew, False
        return [each.candidate(frame.scale) for each in self.objects]

    def without_standing(self, candidates: Sequence[Candidate], scale: float) -> list[Candidate]:
        """Candidates of flow in the frame of the last ``candidates`` less those where the points stand still, which is
        evidence for the others.

        scale: working pixels per full-resolution pixel.
        """
        denied = self._standing.denied(candidates, self._points, scale)
        return [replace(each, log_odds=each.log_odds + NOT_DENIED_LOG_ODDS)
                for each, still in zip(candidates, denied, strict=True) if not still]

    def without_shadows(self, candidates: Sequence[Candidate], scale: float) -> list[Candidate]:
        """Candidates of flow in the frame of the last ``candidates``, their boxes without soft shadows.

        scale: working pixels per full-resolution pixel.
        """
        height, width = self._frames[0].gray.shape
        return [without_shadow(each, self._shadows, scale, width, height) for each in candidates]

    def without_hard_shadows(self, records: RecordArray, width: int, height: int) -> RecordArray:
        """Reported objects of an image of ``width`` x ``height`` pixels without what the scene's objects show of hard
        shadows.
        """
        return self._sun.without_shadows(records, width, height)

    def _use(self, found: _Found) -> None:
        self._points = found.points
        if found.objects is not None and found.standing is not None:
            self.objects, self._standing, self._anew = found.objects, found.standing, True
            self._usual.add([seen_area(each.cluster.low, each.cluster.high) for each in found.objects],
                            self._frames[0].stamp_ns)
            self._sun.add([each.dark for each in found.objects if each.dark is not None], self._frames[0].stamp_ns)

    def _look(
        self, frames: RecentFrames, mask: BoolArray | None, shadows: SoftShadows, camera: CameraModel | None,
    ) -> _Found:
        """Starts new points; finds objects with a camera. frames: their current one is that of the points."""
        points = self._tracker.start(frames, mask)
        if camera is None:
            return _Found(points)
        old: BoolArray = points.age >= frames.nearest(STILL_S)
        motion = object_motion(points, frames, camera)
        self._tracker.told(motion.moving, spare_points(points, motion, frames))
        known, moving = np.flatnonzero(old), np.flatnonzero(old & motion.moving)
        area = self._usual.area
        clusters = ClusteredPoints(find_clusters(points, motion, old, frames, area), points, known, moving,
                                   motion.displacements, area)
        standing = StandingPoints()
        standing.measured(points, motion, known)
        return _Found(points, objects_of(clusters, frames, mask, shadows, self._config, self._score), standing)
