"""Objects that points show, frame by frame."""

from __future__ import annotations

from motion_detect_ros.core.config import PipelineConfig
from motion_detect_ros.core.detection.candidate import Candidate
from motion_detect_ros.core.trajectories.finder import TrajectoryFinder
from motion_detect_ros.core.trajectories.follower import PointFollower
from motion_detect_ros.core.trajectories.point_evidence import PointEvidence
from motion_detect_ros.core.types import CameraModel, EgoMotion, PreparedFrame


class PointObjects:
    """A follower of points and a finder of their objects, one after the other."""

    def __init__(self, config: PipelineConfig) -> None:
        self.follower, self.finder = PointFollower(config), TrajectoryFinder(config)
        self.evidence: PointEvidence

    def candidates(self, frame: PreparedFrame, ego: EgoMotion, camera: CameraModel) -> list[Candidate]:
        followed = self.follower.follow(frame, ego, camera)
        found = self.finder.candidates(followed)
        self.evidence = self.finder.evidence(followed)
        return found

    def wait(self) -> None:
        self.follower.wait()
        self.finder.wait()

    def reset(self) -> None:
        self.follower.reset()
        self.finder.reset()
