"""``pipeline``: image_raw -> ego_motion, flow, detections, all stages in one process."""

from __future__ import annotations

from dataclasses import replace
from functools import cached_property
from typing import Any

from motion_detect_ros.bridge.diagnostics import tuned_pairs, unused_for
from motion_detect_ros.bridge.gyro import Sink
from motion_detect_ros.bridge.images import stamp_ns
from motion_detect_ros.bridge.load_watch import LoadWatch, SteppedNode
from motion_detect_ros.bridge.runner import main_of
from motion_detect_ros.bridge.topics import EGO_MOTION, FLOW, DetectionPublisher, TopicPublisher
from motion_detect_ros.bridge.track_ids import declare_first_id
from motion_detect_ros.core.pipeline import MotionPipeline
from motion_detect_ros.core.types import ByteArray, CameraModel


class PipelineNode(SteppedNode):
    """Publishes what the three stage nodes would; flow only while someone subscribes."""

    def __init__(self) -> None:
        super().__init__('pipeline')
        self._first_id = declare_first_id(self)
        self._load = LoadWatch(self)

    @cached_property
    def _pipeline(self) -> MotionPipeline:
        """One for the life of the process, so that no id is used twice."""
        return MotionPipeline(self.config, first_id=self._first_id)

    def make_stage(self) -> None:
        """Pipeline without history, publishers."""
        self.use_config(restart=True)
        self._pipeline.reset()
        self._ego_publisher = TopicPublisher(self, EGO_MOTION)
        self._flow_publisher = TopicPublisher(self, FLOW)
        self._publisher = DetectionPublisher(self)

    def work(self, header: Any, image: ByteArray) -> str:
        """One image: process and publish, detections first."""
        result = self._pipeline.process(image, stamp_ns(header))
        self.warn_of(self._pipeline.complaints)
        self._publisher.publish(result.detections, header)
        self._ego_publisher.publish(replace(result.ego, load_step=self.load_step), header)
        if self._flow_publisher.subscribers:
            self._flow_publisher.publish(result.flow, header)
        self._load.add(result.times_ms.total)
        times = tuple((f'{name}_ms', f'{value:.2f}') for name, value in vars(result.times_ms).items())
        self.latest = (
            ('status', result.ego.status.name), ('inliers', str(result.ego.inliers)),
            ('tracks', str(result.ego.tracks)), ('objects', str(len(result.detections))),
            ('clusters', str(self._pipeline.neurons)), *tuned_pairs(self._pipeline.tuned), *times,
            ('total_ms', f'{result.times_ms.total:.2f}'))
        return unused_for(result.ego)

    def use_config(self, restart: bool) -> None:
        """Other settings from the next image on; the pipeline knows by itself which need a restart."""
        self._pipeline.use_config(self.config)
        self._load.use_config(restart)

    def limit_width(self, share: float) -> None:
        """Of the images from the next one on."""
        self._pipeline.limit_width(share)

    def use_camera(self, camera: CameraModel | None) -> None:
        """Hand the calibration on."""
        self._pipeline.use_camera(camera)

    def clock_jumped(self) -> None:
        """The pipeline starts anew."""
        self._pipeline.clock_jumped()

    def gyro_sink(self) -> Sink:
        """The pipeline."""
        return self._pipeline.add_gyro

    def forget(self) -> None:
        """All history."""
        self._pipeline.reset()


main = main_of(PipelineNode)

if __name__ == '__main__':
    main()
