"""What a node says on the console: which topics it has, what images come, and that none do."""

from __future__ import annotations

import time
from collections.abc import Iterable
from typing import Any

from rclpy.node import Node
from rclpy.qos import QoSReliabilityPolicy

from motion_detect_ros.bridge.serialized import IMAGE_TYPES

#: The rate of the images is told once so many have come.
RATE_IMAGES = 20
#: Silence is told after this, and again as long after, seconds.
SILENCE_S = 10.0


def endpoints(made: Iterable[Any]) -> str:
    """Topics of publishers or subscriptions with their quality of service, on one line."""
    return ', '.join(
        f'{each.topic_name} ({_reliability(each)}, depth {each.qos_profile.depth})' for each in made) or 'nothing'


def _reliability(endpoint: Any) -> str:
    best_effort = endpoint.qos_profile.reliability == QoSReliabilityPolicy.BEST_EFFORT
    return 'best effort' if best_effort else 'reliable'


class ImageLog:
    """Tells of the first images on a topic and their rate, and of silence with the images that there are elsewhere."""

    def __init__(self, node: Node, topic: str, others: Iterable[str] = ()) -> None:
        """others: topics of the type of images that are no images of a camera, ~ for whichever node publishes them."""
        self._node = node
        self._topic = node.resolve_topic_name(topic)
        self._others = tuple(others)
        self._count = 0
        self._first_s = self._last_s = time.monotonic()

    def arrived(self, msg: Any) -> None:
        """msg: sensor_msgs Image or CompressedImage."""
        self._count, self._last_s = self._count + 1, time.monotonic()
        if self._count == 1:
            self._first_s = self._last_s
            kind = f'{msg.width}x{msg.height} {msg.encoding}' if hasattr(msg, 'encoding') else msg.format
            self._node.get_logger().info(f'first image on {self._topic}: {kind}, frame_id {msg.header.frame_id!r}')
        elif self._count == RATE_IMAGES:
            rate_hz = (RATE_IMAGES - 1) / max(self._last_s - self._first_s, 1e-9)
            self._node.get_logger().info(f'images on {self._topic} come at {rate_hz:.1f} Hz')

    def check(self) -> None:
        """Called now and then: warns where nothing has come for long."""
        silent_s = time.monotonic() - self._last_s
        if silent_s >= SILENCE_S:
            self._node.get_logger().warning(
                f'no images on {self._topic} for {silent_s:.0f} s; {self.elsewhere()}',
                throttle_duration_sec=SILENCE_S)

    def elsewhere(self) -> str:
        """Which other topics have images of a camera, in a few words."""
        found = [f'{name} ({kinds[0].rpartition("/")[2]})' for name, kinds in self._node.get_topic_names_and_types()
                 if set(kinds) & set(IMAGE_TYPES) and self._may_be_meant(name)]
        return f'images are published on {", ".join(found)}' if found else 'nobody publishes others'

    def _may_be_meant(self, name: str) -> bool:
        """Whether images of a camera may be on a topic, and not by the node alone that is waited for."""
        if name in {self._topic, *map(self._node.resolve_topic_name, self._others)}:
            return False
        publishers = self._publishers(name)
        if compressed_beside(name) == self._topic or compressed_beside(self._topic) == name:
            publishers -= self._publishers(self._topic)
        return any(name not in (_of(node, other) for other in self._others) for node in publishers)

    def _publishers(self, topic: str) -> set[tuple[str, str]]:
        """Namespace and name of the nodes that publish there."""
        return {(info.node_namespace, info.node_name) for info in self._node.get_publishers_info_by_topic(topic)}


def compressed_beside(topic: str) -> str:
    """Where a node that publishes raw images on ``topic`` publishes them compressed."""
    return f'{topic}/compressed'


def _of(node: tuple[str, str], topic: str) -> str:
    """Full name of a relative or private (~) topic of a node, given by namespace and name."""
    namespace, name = node
    return '/'.join([namespace.rstrip('/'), *([name] if topic.startswith('~') else []), topic.removeprefix('~/')])
