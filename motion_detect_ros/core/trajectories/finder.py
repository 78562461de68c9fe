"""From followed points to candidates of small and slow objects: clusters, boxes."""

from __future__ import annotations

from dataclasses import dataclass
from functools import partial

import numpy as np

from motion_detect_ros.core.config import ObjectsConfig, PipelineConfig
from motion_detect_ros.core.deferred import LATER_S, Deferred
from motion_detect_ros.core.detection.candidate import Candidate
from motion_detect_ros.core.detection.several_objects import UsualSize
from motion_detect_ros.core.trajectories.clusters import find_clusters
from motion_detect_ros.core.trajectories.follower import FollowedPoints
from motion_detect_ros.core.trajectories.found_objects import ClusteredPoints, FoundObject, moved_on, objects_of
from motion_detect_ros.core.trajectories.hard_shadows import SunSide
from motion_detect_ros.core.trajectories.parted_clusters import LEAST_OBJECTS, seen_area
from motion_detect_ros.core.trajectories.point_evidence import PointEvidence
from motion_detect_ros.core.trajectories.point_scoring import POINT_SCORE, PointScore
from motion_detect_ros.core.trajectories.points import Points
from motion_detect_ros.core.trajectories.standing import StandingPoints
from motion_detect_ros.core.types import BoolArray, RecordArray

#: Points younger than this do not tell whether they stand still, seconds.
STILL_S = 0.2


@dataclass(frozen=True)
class _Found:
    """What the points of one frame show. ``points``: new ones included; ``stamp_ns``: of the frame."""

    points: Points
    objects: list[FoundObject]
    standing: StandingPoints
    stamp_ns: int


class TrajectoryFinder:
    """Holds the objects that points show.

    The answer of a frame waits for its points, not for what they show: objects are found behind it, from its points and
    images, and go where their points go from the next frame on. ``objects``: in the last frame; ``found``: whether they
    were found anew for it.
    """

    def __init__(self, config: PipelineConfig, score: PointScore = POINT_SCORE) -> None:
        self._config, self._score = config.objects, score
        self._behind = Deferred[_Found | None]('trajectories')
        self._sun, self._usual = SunSide(), UsualSize(LEAST_OBJECTS)
        self._start_anew(0)

    def use_config(self, config: PipelineConfig) -> None:
        """Settings of objects from the next frame on."""
        self._config = config.objects

    def reset(self) -> None:
        """Clear all objects."""
        self._behind.drop()
        self._start_anew(0)

    def wait(self) -> None:
        """Until what is done behind the last frame is done; ``candidates`` does so itself."""
        self._behind.wait()

    def _start_anew(self, run: int) -> None:
        self._run = run
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

    def candidates(self, followed: FollowedPoints) -> list[Candidate]:
        """Objects in the frame of these points, each frame once, in their order."""
        self.take()
        if followed.run != self._run:
            self._start_anew(followed.run)
        before, self._points = self._points, followed.points
        self.objects = moved_on(self.objects, before, self._points)
        if followed.shows_motion:
            look = partial(self._look, followed, self._config, self._usual.area)
            if self.objects and followed.dt_s <= LATER_S:
                self._behind.start(look)
            elif (found := look()) is not None:
                self._use(found)
        self.found, self._anew = self._anew, False
        return [each.candidate(followed.scale) for each in self.objects]

    def evidence(self, followed: FollowedPoints) -> PointEvidence:
        """What the points tell of flow in the frame of the last ``candidates``."""
        return PointEvidence(self._points, self._standing, followed.shadows, followed.frames[0].gray.shape,
                             followed.scale)

    def without_hard_shadows(self, records: RecordArray, width: int, height: int) -> RecordArray:
        """Reported objects of an image of ``width`` x ``height`` pixels without what the scene's objects show of hard
        shadows.
        """
        return self._sun.without_shadows(records, width, height)

    def _use(self, found: _Found) -> None:
        self._points, self.objects, self._standing, self._anew = found.points, found.objects, found.standing, True
        self._usual.add([seen_area(each.cluster.low, each.cluster.high) for each in found.objects], found.stamp_ns)
        self._sun.add([each.dark for each in found.objects if each.dark is not None], found.stamp_ns)

    def _look(self, followed: FollowedPoints, config: ObjectsConfig, usual_area: float | None) -> _Found | None:
        """None where the motion of the points is not known; what raised there is raised to who follows them."""
        moved = followed.moved()
        if moved is None:
            return None
        points, motion, frames = moved.points, moved.motion, followed.frames
        old: BoolArray = points.age >= frames.nearest(STILL_S)
        known, moving = np.flatnonzero(old), np.flatnonzero(old & motion.moving)
        clusters = ClusteredPoints(find_clusters(points, motion, old, frames, usual_area), points, known, moving,
                                   motion.displacements, usual_area)
        standing = StandingPoints()
        standing.measured(points, motion, known)
        objects = objects_of(clusters, frames, followed.mask, followed.shadows, config, self._score)
        return _Found(points, objects, standing, frames[0].stamp_ns)
