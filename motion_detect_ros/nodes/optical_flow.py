"""``optical_flow``: image_raw + ego_motion -> flow."""

from __future__ import annotations

from sensor_msgs.msg import Image, PointCloud2
from std_msgs.msg import Header

from motion_detect_ros.bridge.images import flow_to_msg, image_from_msg, stamp_ns
from motion_detect_ros.bridge.qos import image_qos, overridable
from motion_detect_ros.bridge.records import ego_from_msg
from motion_detect_ros.bridge.runner import main_of
from motion_detect_ros.bridge.stage_node import StageNode
from motion_detect_ros.core.optical_flow import OpticalFlowStage
from motion_detect_ros.core.preprocessing import Preprocessor


class OpticalFlowNode(StageNode):
    """Publishes the dense flow of each image, on the stabilised pair."""

    inputs = (('ego_motion', PointCloud2),)

    def __init__(self) -> None:
        super().__init__('optical_flow')

    def make_stage(self) -> None:
        """Stage and publisher."""
        self._preprocessor = Preprocessor(self.config.preprocessing)
        self._stage = OpticalFlowStage(self.config)
        self._publisher = self.create_lifecycle_publisher(
            Image, 'flow', image_qos(), qos_overriding_options=overridable())

    def work(self, image: Image, ego_motion: PointCloud2) -> Header:
        """One image: flow and publish."""
        frame = self._preprocessor.process(image_from_msg(image), stamp_ns(image.header))
        flow = self._stage.process(frame, ego_from_msg(ego_motion))
        self._publisher.publish(flow_to_msg(flow, image.header))
        return image.header

    def reset(self) -> None:
        """Forget earlier frames."""
        self.locked(self._stage.reset)


main = main_of(OpticalFlowNode)

if __name__ == '__main__':
    main()
