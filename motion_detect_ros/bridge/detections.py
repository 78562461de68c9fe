"""Publishing detections: always as records, and as vision_msgs boxes where that package is installed."""

from __future__ import annotations

from importlib import import_module
from typing import Any

from rclpy.lifecycle import LifecycleNode
from sensor_msgs.msg import PointCloud2
from std_msgs.msg import Header

from motion_detect_ros.bridge.qos import overridable, record_qos
from motion_detect_ros.bridge.records import detections_to_msg
from motion_detect_ros.core.types import RecordArray


class DetectionPublisher:
    """``detections``, and ``detections_2d`` (vision_msgs/Detection2DArray) where possible."""

    def __init__(self, node: LifecycleNode) -> None:
        options = {'qos_overriding_options': overridable()}
        self._records = node.create_lifecycle_publisher(PointCloud2, 'detections', record_qos(), **options)
        self._vision = _vision_messages()
        self._boxes = self._vision and node.create_lifecycle_publisher(
            self._vision.Detection2DArray, 'detections_2d', record_qos(), **options)

    def publish(self, records: RecordArray, header: Header) -> None:
        """records: dtype ``DETECTION_DTYPE``; header: of the image they were seen in."""
        self._records.publish(detections_to_msg(records, header))
        if self._boxes and self._boxes.get_subscription_count():
            self._boxes.publish(self._as_boxes(records, header))

    def _as_boxes(self, records: RecordArray, header: Header) -> Any:
        vision = self._vision
        message = vision.Detection2DArray(header=header)
        for record in records:
            box = vision.Detection2D(header=header, id=str(record['id']))
            box.bbox.center.position.x, box.bbox.center.position.y = float(record['u']), float(record['v'])
            box.bbox.size_x, box.bbox.size_y = float(record['width']), float(record['height'])
            result = vision.ObjectHypothesisWithPose()
            result.hypothesis.class_id, result.hypothesis.score = 'moving', float(record['score'])
            box.results.append(result)
            message.detections.append(box)
        return message


def _vision_messages() -> Any:
    try:
        return import_module('vision_msgs.msg')
    except ImportError:
        return None
