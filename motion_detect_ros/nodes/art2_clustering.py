"""``art2_clustering``: image_raw + flow + ego_motion -> detections."""

from __future__ import annotations

from functools import cached_property
from typing import Any

from motion_detect_ros.bridge.diagnostics import tuned_pairs, unused_for
from motion_detect_ros.bridge.images import stamp_ns
from motion_detect_ros.bridge.load import Stage
from motion_detect_ros.bridge.load_watch import StageLoad, SteppedNode
from motion_detect_ros.bridge.runner import main_of
from motion_detect_ros.bridge.topics import EGO_MOTION, FLOW, DetectionPublisher
from motion_detect_ros.bridge.track_ids import declare_first_id
from motion_detect_ros.core.clustering_stage import ClusteringStage
from motion_detect_ros.core.errors import MessageError
from motion_detect_ros.core.geometry.frame_history import FrameHistory
from motion_detect_ros.core.optical_flow.stage import grid_shape
from motion_detect_ros.core.preprocessing.stage import Preprocessor
from motion_detect_ros.core.types import ByteArray, CameraModel, EgoMotion, FlowField


class Art2ClusteringNode(SteppedNode):
    """Publishes the moving objects of each image."""

    inputs = (FLOW, EGO_MOTION)
    used = ('preprocessing.', 'optical_flow.baseline_s', 'optical_flow.every_s', 'optical_flow.grid_px', 'background.',
            'art2.', 'objects.', 'trajectories.', 'tracks.', 'load.', 'self_tuning.')

    def __init__(self) -> None:
        super().__init__('art2_clustering')
        self._first_id = declare_first_id(self)
        self._load = StageLoad(self, Stage.ART2_CLUSTERING)

    @cached_property
    def _stage(self) -> ClusteringStage:
        """One for the life of the process, so that no id is used twice."""
        return ClusteringStage(self.config, first_id=self._first_id)

    def make_stage(self) -> None:
        """Stage without history, publisher."""
        self._start_anew()
        self._load.advertise()
        self._publisher = DetectionPublisher(self)

    def _start_anew(self) -> None:
        self._preprocessor = Preprocessor(self.config.preprocessing)
        self._history = FrameHistory(self.config.optical_flow.baseline_s)
        self._stage.restart(self.config)

    def use_config(self, restart: bool) -> None:
        """Other settings from the next image on."""
        if restart:
            self._start_anew()
        else:
            self._stage.use_config(self.config)

    def work(self, header: Any, image: ByteArray, flow: FlowField, ego: EgoMotion) -> str:
        """One image: detect and publish."""
        with self._load.image(header, ego.load_step):
            return self._detect(header, image, flow, ego)

    def _detect(self, header: Any, image: ByteArray, flow: FlowField, ego: EgoMotion) -> str:
        frame = self._preprocessor.process(image, stamp_ns(header))
        self.warn_of(self._preprocessor.complaints)
        expected, got = grid_shape(frame, self.config.optical_flow.grid_px), flow.flow.shape[:2]
        if got != expected:
            raise MessageError(f'{self.resolve_topic_name(FLOW.name)}: expected a grid of {expected[1]}x{expected[0]} '
                               f'cells for these images and settings, got {got[1]}x{got[0]}')
        reference = self._history.step(frame, ego)
        records = self._stage.process(
            frame, ego, reference, FlowField(flow.flow, frame.width, frame.height, flow.stamp_ns))
        self._publisher.publish(records, header)
        self.latest = (('objects', str(len(records))), ('clusters', str(self._stage.neurons)),
                       *tuned_pairs(self._stage.tuned))
        return unused_for(ego, reference is not None)

    def limit_width(self, share: float) -> None:
        """Of the images from the next one on."""
        self._preprocessor.limit_width(share)

    def use_camera(self, camera: CameraModel | None) -> None:
        """Hand the calibration on."""
        self._stage.camera = camera

    def forget(self) -> None:
        """Frames, neurons and tracks."""
        for part in (self._preprocessor, self._history, self._stage):
            part.reset()


main = main_of(Art2ClusteringNode)

if __name__ == '__main__':
    main()
