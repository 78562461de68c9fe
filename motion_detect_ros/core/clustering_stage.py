"""The last stage: residual flow -> ART2 clusters -> objects -> tracks."""

from __future__ import annotations

import numpy as np

from motion_detect_ros.core.config import PipelineConfig
from motion_detect_ros.core.contact import bearings
from motion_detect_ros.core.detector import MotionDetector
from motion_detect_ros.core.expansion import with_growth
from motion_detect_ros.core.memory import Earlier, FrameMemory
from motion_detect_ros.core.optical_flow import total_to_residual
from motion_detect_ros.core.scene_mask import scene_cells
from motion_detect_ros.core.scene_model import SceneModel
from motion_detect_ros.core.static_scene import guessed_camera
from motion_detect_ros.core.track import Candidate
from motion_detect_ros.core.tracks import Tracker
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

#: Nothing seen before such a frame can be found again in it.
STARTS_ANEW = (EgoStatus.FIRST_FRAME, EgoStatus.TIME_JUMP, EgoStatus.SIZE_CHANGE)


class ClusteringStage:
    """Tells moving objects from background in one frame's flow and follows them over frames."""

    def __init__(self, config: PipelineConfig, camera: CameraModel | None = None) -> None:
        self._config = config
        self.camera = camera
        self._memory = FrameMemory(config.optical_flow.baseline_s)
        self._scene = SceneModel(config.background)
        self._detector = MotionDetector(config)
        self._tracker = Tracker(config.tracks)
        self._last: PreparedFrame | None = None

    @property
    def neurons(self) -> int:
        """Committed ART2 neurons, the background's included."""
        return self._detector.neurons

    def reset(self) -> None:
        """Forget earlier frames, neurons and tracks; ids go on counting."""
        self._memory.reset()
        self._scene.reset()
        self._detector.reset()
        self._tracker.reset()
        self._last = None

    def process(self, frame: PreparedFrame, flow: FlowField, ego: EgoMotion) -> RecordArray:
        """Confirmed moving objects in ``frame``, dtype ``DETECTION_DTYPE``; empty where there is no ego-motion."""
        earlier = self._memory.step(frame, ego)
        last, self._last = self._last, frame
        if ego.status in STARTS_ANEW or (last is not None and _unlike(last, frame)):
            self._tracker.reset()
        elif last is not None and last.stamp_ns < ego.prev_stamp_ns:
            self._tracker.wait((ego.prev_stamp_ns - last.stamp_ns) / NANOSECONDS, frame.width)
        if earlier is None:
            self._tracker.skip(ego.matrix if ego.ok else None, ego.dt_s, frame.width, frame.height)
            return empty_detections()
        candidates = self._candidates(frame, earlier, flow)
        records = self._tracker.step(candidates, ego.matrix, ego.dt_s, frame.width, frame.height, frame.gray)
        return bearings(records, self.camera and self.camera.resized(frame.width, frame.height))

    def _candidates(self, frame: PreparedFrame, earlier: Earlier, flow: FlowField) -> list[Candidate]:
        residual = total_to_residual(flow.flow, earlier.matrix, flow.width, flow.height)
        if frame.mask is not None:
            residual[~scene_cells(frame.mask, earlier.matrix, frame.scale, *residual.shape[:2])] = np.nan
        background = self._scene.fit(flow.flow, residual, self._camera_of(flow))
        found = self._detector.candidates(residual, background, frame, earlier)
        return with_growth(found, flow, residual - background.flow, earlier.seconds)

    def _camera_of(self, flow: FlowField) -> CameraModel:
        """The calibration in the flow's pixels; a guess where there is none."""
        if self.camera is None:
            return guessed_camera(flow.width, flow.height, self._config.background.focal_share)
        return self.camera.resized(flow.width, flow.height)


def _unlike(last: PreparedFrame, frame: PreparedFrame) -> bool:
    """Whether the clock or the size jumped between them, which the frame whose status said so may not have lived to."""
    return frame.stamp_ns <= last.stamp_ns or (frame.width, frame.height) != (last.width, last.height)
