"""``art2_clustering``: image_raw + flow + ego_motion -> detections."""

from __future__ import annotations

from sensor_msgs.msg import Image, PointCloud2
from std_msgs.msg import Header

from motion_detect_ros.bridge.detections import DetectionPublisher
from motion_detect_ros.bridge.images import flow_from_msg, image_from_msg, stamp_ns
from motion_detect_ros.bridge.records import ego_from_msg
from motion_detect_ros.bridge.runner import main_of
from motion_detect_ros.bridge.stage_node import StageNode
from motion_detect_ros.core.clustering_stage import ClusteringStage
from motion_detect_ros.core.preprocessing import Preprocessor
from motion_detect_ros.core.types import CameraModel


class Art2ClusteringNode(StageNode):
    """Publishes the moving objects of each image."""

    inputs = (('flow', Image), ('ego_motion', PointCloud2))

    def __init__(self) -> None:
        super().__init__('art2_clustering')
        self._latest: tuple[tuple[str, str], ...] = ()

    def make_stage(self) -> None:
        """Stage and publisher."""
        self._preprocessor = Preprocessor(self.config.preprocessing)
        self._stage = ClusteringStage(self.config)
        self._publisher = DetectionPublisher(self)

    def work(self, image: Image, flow: Image, ego_motion: PointCloud2) -> Header:
        """One image: detect and publish."""
        frame = self._preprocessor.process(image_from_msg(image), stamp_ns(image.header))
        field = flow_from_msg(flow, frame.width, frame.height)
        records = self._stage.process(frame, field, ego_from_msg(ego_motion))
        self._publisher.publish(records, image.header)
        self._latest = (('objects', str(len(records))), ('neurons', str(self._stage.neurons)))
        return image.header

    def use_camera(self, camera: CameraModel) -> None:
        """Hand the calibration on."""
        self._stage.camera = camera

    def reset(self) -> None:
        """Forget frames, neurons and tracks."""
        self.locked(self._stage.reset)

    def extra_diagnostics(self) -> tuple[tuple[str, str], ...]:
        """Objects and neurons of the latest frame."""
        return self._latest


main = main_of(Art2ClusteringNode)

if __name__ == '__main__':
    main()
