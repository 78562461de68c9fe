"""The topics of the graph: name, message type, quality of service, and how a value becomes a message and back."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from importlib import import_module
from typing import Any

from diagnostic_msgs.msg import DiagnosticArray
from rclpy.qos import QoSProfile
from rosgraph_msgs.msg import Clock
from sensor_msgs.msg import CameraInfo, CompressedImage, Image, Imu, PointCloud2
from std_msgs.msg import Header
from visualization_msgs.msg import MarkerArray

from motion_detect_ros.bridge.images import (
    compressed_to_msg,
    flow_from_msg,
    flow_to_msg,
    image_from_msg,
    image_to_msg,
    stamp_of,
)
from motion_detect_ros.bridge.managed_node import ManagedNode
from motion_detect_ros.bridge.qos import clock_qos, diagnostics_qos, image_qos, imu_qos, record_qos
from motion_detect_ros.bridge.records import detections_to_msg, ego_from_msg, ego_to_msg, read_detections
from motion_detect_ros.core.types import NANOSECONDS, RecordArray
from motion_detect_ros.sources.camera_info import camera_of
from motion_detect_ros.sources.inertial import rates_of


@dataclass(frozen=True)
class Topic:
    """``to_msg(value, header)`` and ``from_msg(message)`` convert; ``qos`` is what its publishers offer."""

    name: str
    kind: Any
    to_msg: Callable[[Any, Header], Any]
    from_msg: Callable[[Any], Any]
    qos: Callable[[], QoSProfile]


def _as_it_is(message: Any, _header: Header | None = None) -> Any:
    return message


DIAGNOSTICS = Topic('/diagnostics', DiagnosticArray, _as_it_is, _as_it_is, diagnostics_qos)
IMAGE = Topic('image_raw', Image, image_to_msg, image_from_msg, image_qos)
COMPRESSED = Topic('image_raw/compressed', CompressedImage, compressed_to_msg, image_from_msg, image_qos)
CAMERA_INFO = Topic('camera_info', CameraInfo, _as_it_is, camera_of, image_qos)
IMU = Topic('imu', Imu, _as_it_is, rates_of, imu_qos)
EGO_MOTION = Topic('ego_motion', PointCloud2, ego_to_msg, ego_from_msg, record_qos)
FLOW = Topic('flow', Image, flow_to_msg, flow_from_msg, image_qos)
DETECTIONS = Topic('detections', PointCloud2, detections_to_msg, read_detections, record_qos)
CLOCK = Topic('/clock', Clock, lambda ns, _: Clock(clock=stamp_of(ns)),
              lambda msg: msg.clock.sec * NANOSECONDS + msg.clock.nanosec, clock_qos)
OVERLAY = Topic('~/overlay', Image, image_to_msg, image_from_msg, image_qos)
OVERLAY_JPEG = Topic('~/overlay/compressed', CompressedImage, compressed_to_msg, image_from_msg, image_qos)
MARKERS = Topic('~/markers', MarkerArray, _as_it_is, _as_it_is, record_qos)
FLOW_COLORS = Topic('~/flow', Image, image_to_msg, image_from_msg, image_qos)
#: Topics of the type of images on which nodes of the package publish something else than a camera's.
NO_CAMERA = FLOW, OVERLAY, OVERLAY_JPEG, FLOW_COLORS


class TopicPublisher:
    """Publishes values on a topic while the node is active."""

    def __init__(self, node: ManagedNode, topic: Topic) -> None:
        self._topic = topic
        self.publisher = node.advertise(topic.kind, topic.name, topic.qos())

    def publish(self, value: Any, header: Header | None = None) -> None:
        """value: what the topic's ``to_msg`` takes; header: of the image it belongs to."""
        self.publisher.publish(self._topic.to_msg(value, header))

    @property
    def subscribers(self) -> int:
        """How many subscriptions match it."""
        return int(self.publisher.get_subscription_count())


class DetectionPublisher:
    """``detections``, and ``detections_2d`` (vision_msgs/Detection2DArray) where that package is installed."""

    def __init__(self, node: ManagedNode) -> None:
        self._records = TopicPublisher(node, DETECTIONS)
        vision = _vision_messages()
        self._boxes = vision and TopicPublisher(node, Topic(
            'detections_2d', vision.Detection2DArray, lambda records, header: _as_boxes(vision, records, header),
            _as_it_is, record_qos))

    def publish(self, records: RecordArray, header: Header) -> None:
        """records: dtype ``DETECTION_DTYPE``; header: of the image they were seen in."""
        self._records.publish(records, header)
        if self._boxes and self._boxes.subscribers:
            self._boxes.publish(records, header)


def _as_boxes(vision: Any, records: RecordArray, header: Header) -> Any:
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
