"""The last stage: residual flow -> background -> ART2 clusters -> objects -> tracks."""

from __future__ import annotations

from dataclasses import dataclass
from functools import partial

import numpy as np

from motion_detect_ros.core.background.selection import BackgroundSelector
from motion_detect_ros.core.clustering.clusterer import Clusterer
from motion_detect_ros.core.config import PipelineConfig
from motion_detect_ros.core.deferred import LATER_S, Deferred
from motion_detect_ros.core.detection.candidate import Candidate
from motion_detect_ros.core.detection.detector import MotionDetector
from motion_detect_ros.core.detection.last_flow import LastFlow
from motion_detect_ros.core.geometry.bearings import bearings
from motion_detect_ros.core.geometry.frame_history import ReferenceFrame
from motion_detect_ros.core.optical_flow.conversion import residual_flow
from motion_detect_ros.core.preprocessing.scene_mask import scene_cells
from motion_detect_ros.core.self_tuning import Tuned
from motion_detect_ros.core.tracking.tracker import Tracker
from motion_detect_ros.core.trajectories.clusters import MAX_SIDE_SHARE
from motion_detect_ros.core.trajectories.finder import TrajectoryFinder
from motion_detect_ros.core.trajectories.follower import FollowedPoints, PointFollower
from motion_detect_ros.core.trajectories.point_evidence import PointEvidence
from motion_detect_ros.core.trajectories.point_scoring import POINT_SCORE, PointScore
from motion_detect_ros.core.trajectories.union import united
from motion_detect_ros.core.types import (
    NANOSECONDS,
    CameraModel,
    EgoMotion,
    EgoStatus,
    FlowField,
    PreparedFrame,
    RecordArray,
    empty_detections,
)

#: Tracks cannot be continued across such a frame, nor over a longer time than this without a motion, seconds.
STARTS_ANEW, MAX_UNSEEN_S = (EgoStatus.FIRST_FRAME, EgoStatus.TIME_JUMP, EgoStatus.SIZE_CHANGE), 1.0


@dataclass(frozen=True)
class Followed:
    """What ``ClusteringStage.follow`` has done. ``points``: None where none are used."""

    points: FollowedPoints | None


class ClusteringStage:
    """Separates moving objects from the background in one frame's flow and tracks them over frames.

    ``neurons``: committed ART2 neurons, the background's included; ``tuned``: settings in use that ``self_tuning`` may
    have changed. Where points are tracked too, the objects of a flow are looked for behind the answer, like theirs, if
    there are earlier ones to go on with (``flow_is_behind``): a flow that is pending is computed there. clusterer:
    replaces the ART2 that ``config`` describes; first_id: as for ``Tracker``; point_score: of small objects.
    """

    def __init__(
        self, config: PipelineConfig, camera: CameraModel | None = None, clusterer: Clusterer | None = None,
        first_id: int = 1, point_score: PointScore = POINT_SCORE,
    ) -> None:
        self.camera = camera
        self._clusterer, self._point_score = clusterer, point_score
        self._tracker = Tracker(config.tracks, first_id)
        self._behind = Deferred[list[Candidate] | None]('flow_objects')
        self.restart(config)

    def restart(self, config: PipelineConfig) -> None:
        """Any settings, without any history; ids go on counting."""
        self._behind.drop()
        self._config = config
        self._scene = BackgroundSelector(config.background, config.self_tuning)
        self._detector = MotionDetector(config, self._clusterer)
        self._last_flow = LastFlow(config.optical_flow.every_s)
        self._follower = PointFollower(config) if config.trajectories.use else None
        self._trajectories = TrajectoryFinder(config, self._point_score) if config.trajectories.use else None
        self._tracker.use_config(config.tracks)
        self._tracker.reset()
        self._last: PreparedFrame | None = None
        self.flow_is_behind = False
        self._note()

    def use_config(self, config: PipelineConfig) -> None:
        """Settings from the next frame on that keep history (``core.reconfiguration``)."""
        self._behind.wait()
        self._config = config
        self._scene.use_config(config.background)
        self._detector.use_config(config)
        if self._trajectories is not None:
            self._trajectories.use_config(config)
        self._tracker.use_config(config.tracks)
        self._note()

    def reset(self) -> None:
        """Clear earlier frames, neurons and tracks; ids go on counting."""
        self._behind.drop()
        for part in (self._scene, self._detector, self._last_flow, self._follower, self._trajectories, self._tracker):
            if part is not None:
                part.reset()
        self._last = None
        self._note()

    def wait(self) -> None:
        """Until what is done behind the last frame is done; ``process`` does so itself."""
        for part in (self._behind, self._follower, self._trajectories):
            if part is not None:
                part.wait()

    def follow(self, frame: PreparedFrame, ego: EgoMotion, camera: CameraModel | None) -> Followed:
        """Where points go. Each frame once, in their order.

        ego: motion into ``frame``; camera: calibration of its image. Raises: what was raised behind the last frame.
        """
        if self._follower is None or ego.passed_over:
            return Followed(None)
        height, width = frame.gray.shape
        return Followed(self._follower.follow(frame, ego, self._known(camera, width, height)))

    def process(
        self, frame: PreparedFrame, ego: EgoMotion, reference: ReferenceFrame | None, flow: FlowField,
        followed: Followed | None = None,
    ) -> RecordArray:
        """Confirmed moving objects in ``frame``, dtype ``DETECTION_DTYPE``; empty where there is no reference.

        ego: motion into ``frame``; reference: what ``FrameHistory`` returns for it; flow: from there into ``frame``;
        followed: what ``follow`` has returned for it, which another thread may do for the next frames meanwhile; None
        = it has not been called.
        """
        self.flow_is_behind = False
        points = (followed or self.follow(frame, ego, self.camera)).points
        found = self._behind.take()  # before anything else changes, as it may raise
        if self._trajectories is not None:
            self._trajectories.take()
        if found is not None:
            self._last_flow.replaced_late(found)
            self._note()
        if ego.passed_over:  # as if it had never come
            return empty_detections()
        if not self._can_wait(ego):
            flow.settle()  # as that may raise, too
        last, self._last = self._last, frame
        if ego.status in STARTS_ANEW or (last is not None and _unlike(last, ego, frame)):
            for part in (self._scene, self._detector, self._last_flow, self._tracker):
                part.reset()
            self._note()
        elif last is not None:
            self._continue(last, frame, ego)
        from_flow = self._last_flow.carried(ego)
        if reference is None:
            self._from_points(points)
            self._tracker.coast(ego.matrix, ego.dt_s, frame.width, frame.height)
            return empty_detections()
        due = flow.pending or flow.measured or not self._config.optical_flow.every_s
        later = self._can_wait(ego)
        from_points, evidence = self._from_points(points)
        look = partial(self._found, frame, reference, flow, self._last_flow.age_s,
                       self._known(self.camera, flow.width, flow.height), evidence)
        if due and later:
            self.flow_is_behind = self._behind.start(look)
        elif due and (found := look()) is not None:
            from_flow = self._last_flow.replaced(found)
            self._note()
        candidates = united(from_flow, from_points, MAX_SIDE_SHARE * frame.width)
        records = self._tracker.step(candidates, ego.matrix, ego.dt_s, frame.width, frame.height, frame.gray)
        if self._trajectories is not None:
            records = self._trajectories.without_hard_shadows(records, frame.width, frame.height)
        return bearings(records, self.camera and self.camera.resized(frame.width, frame.height))

    def _can_wait(self, ego: EgoMotion) -> bool:
        """Whether the answer can do without the objects of a new flow."""
        return (self._trajectories is not None and self._config.optical_flow.every_s > 0.0
                and not self._last_flow.empty and ego.dt_s <= LATER_S)

    def _note(self) -> None:
        art2 = self._detector.art2
        self.neurons = self._detector.neurons
        self.tuned = Tuned(self._scene.noise_floor_px, art2.initial_neurons, art2.max_neurons)

    def _continue(self, last: PreparedFrame, frame: PreparedFrame, ego: EgoMotion) -> None:
        if last.gray.shape != frame.gray.shape:  # only the working resolution has changed
            for part in (self._scene, self._detector):
                part.reset()
        if last.stamp_ns < ego.prev_stamp_ns:  # the frame between them is missing, and the motion into it
            self._last_flow.reset()
            self._tracker.coast_without_frame((ego.prev_stamp_ns - last.stamp_ns) / NANOSECONDS, frame.width)

    def _found(
        self, frame: PreparedFrame, reference: ReferenceFrame, flow: FlowField, dt_s: float, camera: CameraModel,
        evidence: PointEvidence | None,
    ) -> list[Candidate] | None:
        """Moving objects of a flow; None where nothing of it is known, which is as if there were none."""
        if self._config.optical_flow.every_s and not flow.measured:
            return None
        found = self._candidates(frame, reference, flow, dt_s, camera)
        return found if evidence is None else evidence.without_shadows(evidence.without_standing(found))

    def _candidates(
        self, frame: PreparedFrame, reference: ReferenceFrame, flow: FlowField, dt_s: float, camera: CameraModel,
    ) -> list[Candidate]:
        residual = residual_flow(flow.flow, reference.matrix, flow.width, flow.height)
        if frame.mask is not None:
            residual[~scene_cells(frame.mask, reference.matrix, frame.scale, *residual.shape[:2])] = np.nan
        background = self._scene.fit(flow.flow, residual, camera, dt_s)
        return self._detector.candidates(flow, residual, background, frame, reference, dt_s)

    def _from_points(self, points: FollowedPoints | None) -> tuple[list[Candidate], PointEvidence | None]:
        if self._trajectories is None or points is None:
            return [], None
        return self._trajectories.candidates(points), self._trajectories.evidence(points)

    def _known(self, camera: CameraModel | None, width: int, height: int) -> CameraModel:
        """A calibration in the pixels of an image of this size; a guess where there is none."""
        if camera is None:
            return CameraModel.guessed(width, height, self._config.background.focal_share)
        return camera.resized(width, height)


def _unlike(last: PreparedFrame, ego: EgoMotion, frame: PreparedFrame) -> bool:
    """Whether the stamp or the size jumped between them; the frame whose status said so may have been dropped.

    ego: motion into ``frame``, which may start long after ``last``: no motion was seen in between.
    """
    unseen_s = (ego.prev_stamp_ns - last.stamp_ns) / NANOSECONDS
    return (frame.stamp_ns <= last.stamp_ns or unseen_s > MAX_UNSEEN_S
            or (frame.width, frame.height) != (last.width, last.height))
