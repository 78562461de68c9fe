"""What a user tells a node about the images that it subscribes to."""

from __future__ import annotations

from dataclasses import dataclass, replace

from rclpy.node import Node

from motion_detect_ros.bridge.console import compressed_beside
from motion_detect_ros.bridge.params import declare_simple
from motion_detect_ros.bridge.qos import IMAGE_RELIABILITIES, IMAGE_TRANSPORTS
from motion_detect_ros.bridge.topics import COMPRESSED, IMAGE, Topic


@dataclass(frozen=True)
class ImageInput:
    """The parameters ``image_reliability``, ``image_transport`` and ``rectified`` (as for ``camera_of``), and the
    ``topic`` on which images come.
    """

    reliability: str
    compressed: bool
    rectified: bool
    topic: Topic

    @classmethod
    def declared(cls, node: Node) -> ImageInput:
        """Declares them. Raises: ConfigError for a word that is none of the choices."""
        reliability = str(declare_simple(
            node, 'image_reliability', 'auto', 'asked of image publishers; auto: reliable, best effort where one is',
            choices=IMAGE_RELIABILITIES))
        transport = declare_simple(
            node, 'image_transport', 'raw', 'images: image_raw or image_raw/compressed', choices=IMAGE_TRANSPORTS)
        rectified = bool(declare_simple(
            node, 'rectified', False, 'the images are rectified: camera_info matrix P holds, not K'))
        compressed = transport == 'compressed'
        return cls(reliability, compressed, rectified, _compressed_topic(node) if compressed else IMAGE)

    @property
    def relaxes(self) -> bool:
        """Whether best effort is taken where a publisher offers no more."""
        return self.reliability == 'auto'


def _compressed_topic(node: Node) -> Topic:
    """Beside the raw images, wherever these are remapped to, as image_transport has it; its own remapping wins."""
    if _remapped(node, COMPRESSED.name) or not _remapped(node, IMAGE.name):
        return COMPRESSED
    return replace(COMPRESSED, name=compressed_beside(node.resolve_topic_name(IMAGE.name)))


def _remapped(node: Node, name: str) -> bool:
    return node.resolve_topic_name(name) != node.resolve_topic_name(name, only_expand=True)
