"""``pipeline``: image_raw -> ego_motion, flow, detections, all stages in one process."""

from __future__ import annotations

from typing import Any

from motion_detect_ros.bridge.images import stamp_ns
from motion_detect_ros.bridge.runner import main_of
from motion_detect_ros.bridge.stage_node import StageNode
from motion_detect_ros.bridge.topics import EGO_MOTION, FLOW, DetectionPublisher, TopicPublisher
from motion_detect_ros.core.pipeline import MotionPipeline
from motion_detect_ros.core.types import ByteArray, CameraModel, StageTimes


class PipelineNode(StageNode):
    """Publishes what the three stage nodes would; flow only when someone listens."""

    def __init__(self) -> None:
        super().__init__('pipeline')
        self._times = StageTimes()
        self._objects = 0

    def make_stage(self) -> None:
        """Pipeline and publishers."""
        self._pipeline = MotionPipeline(self.config)
        self._ego_publisher = TopicPublisher(self, EGO_MOTION)
        self._flow_publisher = TopicPublisher(self, FLOW)
        self._publisher = DetectionPublisher(self)

    def work(self, header: Any, image: ByteArray) -> None:  # type: ignore[override]
        """One image: process and publish, detections first."""
        result = self._pipeline.process(image, stamp_ns(header))
        self._publisher.publish(result.detections, header)
        self._ego_publisher.publish(result.ego, header)
        if self._flow_publisher.listeners:
            self._flow_publisher.publish(result.flow, header)
        self._times, self._objects = result.times_ms, len(result.detections)

    def use_camera(self, camera: CameraModel) -> None:
        """Hand the calibration on."""
        self._pipeline.use_camera(camera)

    def reset(self) -> None:
        """Forget all history."""
        self.locked(self._pipeline.reset)

    def extra_diagnostics(self) -> tuple[tuple[str, str], ...]:
        """Objects and stage times of the latest frame."""
        times = tuple((f'{name}_ms', f'{value:.2f}') for name, value in vars(self._times).items())
        return (('objects', str(self._objects)), *times)


main = main_of(PipelineNode)

if __name__ == '__main__':
    main()
