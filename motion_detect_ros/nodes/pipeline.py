"""``pipeline``: image_raw -> ego_motion, flow, detections, all stages in one process."""

from __future__ import annotations

from sensor_msgs.msg import Image, PointCloud2
from std_msgs.msg import Header

from motion_detect_ros.bridge.detections import DetectionPublisher
from motion_detect_ros.bridge.images import flow_to_msg, image_from_msg, stamp_ns
from motion_detect_ros.bridge.qos import image_qos, overridable, record_qos
from motion_detect_ros.bridge.records import ego_to_msg
from motion_detect_ros.bridge.runner import main_of
from motion_detect_ros.bridge.stage_node import StageNode
from motion_detect_ros.core.pipeline import MotionPipeline
from motion_detect_ros.core.types import CameraModel, StageTimes


class PipelineNode(StageNode):
    """Publishes what the three stage nodes would; flow only when someone listens."""

    def __init__(self) -> None:
        super().__init__('pipeline')
        self._times = StageTimes()
        self._objects = 0

    def make_stage(self) -> None:
        """Pipeline and publishers."""
        self._pipeline = MotionPipeline(self.config)
        options = {'qos_overriding_options': overridable()}
        self._ego_publisher = self.create_lifecycle_publisher(PointCloud2, 'ego_motion', record_qos(), **options)
        self._flow_publisher = self.create_lifecycle_publisher(Image, 'flow', image_qos(), **options)
        self._publisher = DetectionPublisher(self)

    def work(self, image: Image) -> Header:
        """One image: process and publish, detections first."""
        result = self._pipeline.process(image_from_msg(image), stamp_ns(image.header))
        self._publisher.publish(result.detections, image.header)
        self._ego_publisher.publish(ego_to_msg(result.ego, image.header))
        if self._flow_publisher.get_subscription_count():
            self._flow_publisher.publish(flow_to_msg(result.flow, image.header))
        self._times, self._objects = result.times_ms, len(result.detections)
        return image.header

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
