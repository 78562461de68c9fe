"""A peer of the nodes over DDS, as a user's node would be, and what it publishes to them."""

from __future__ import annotations

import time
from collections.abc import Callable
from typing import Any

import numpy as np
import rclpy
from rclpy.context import Context
from rclpy.executors import SingleThreadedExecutor
from rclpy.qos import QoSProfile, QoSReliabilityPolicy
from sensor_msgs.msg import Image

from motion_detect_ros.bridge.images import header_of, image_to_msg

TIMEOUT_S = 60.0
#: Between seeing a subscription in the graph and the publisher having matched it.
MATCHING_S = 0.3


class Peer:
    """A node of our own in this process."""

    def __init__(self, domain_id: int, namespace: str = '') -> None:
        self._context = Context()
        rclpy.init(context=self._context, domain_id=domain_id)
        self.node = rclpy.create_node('peer', context=self._context, namespace=namespace)
        self._executor = SingleThreadedExecutor(context=self._context)
        self._executor.add_node(self.node)
        self._received: dict[str, list[Any]] = {}

    def subscribe(self, kind: Any, topic: str, depth: int = 100) -> list[Any]:
        """Messages of a topic, as they come."""
        received = self._received.setdefault(topic, [])
        self.node.create_subscription(kind, topic, received.append, depth)
        return received

    def advertise(self, kind: Any, topic: str, *, best_effort: bool = False) -> Any:
        """A publisher."""
        reliability = QoSReliabilityPolicy.BEST_EFFORT if best_effort else QoSReliabilityPolicy.RELIABLE
        return self.node.create_publisher(kind, topic, QoSProfile(depth=10, reliability=reliability))

    def until(self, condition: Callable[[], object], timeout_s: float = TIMEOUT_S) -> bool:
        """Spins until ``condition`` holds; False where it never does."""
        deadline = time.monotonic() + timeout_s
        while not condition():
            if time.monotonic() > deadline:
                return False
            self._executor.spin_once(timeout_sec=0.05)
        return True

    def call(self, kind: Any, service: str, **request: Any) -> Any:
        """The answer of a service."""
        client = self.node.create_client(kind, service)
        assert self.until(client.service_is_ready), service
        answer = client.call_async(kind.Request(**request))
        assert self.until(answer.done), service
        self.node.destroy_client(client)
        return answer.result()

    def close(self) -> None:
        """Leave the graph."""
        self._executor.shutdown(timeout_sec=2.0)
        self.node.destroy_node()
        rclpy.try_shutdown(context=self._context)


def small(*arguments: str) -> list[str]:
    """Parameters under which a stage is warm at once, and more."""
    given = ['-p', 'preprocessing.max_width_px:=320']
    for argument in arguments:
        given += ['-p', argument]
    return given


def picture(index: int, height: int = 240, width: int = 320) -> np.ndarray:
    """A textured ground under a camera that drifts 2 pixels a frame, and a block that goes 5 pixels the other way."""
    ground = np.kron(np.random.default_rng(1).integers(0, 256, (70, 140), np.uint8), np.ones((5, 5), np.uint8))
    block = np.kron(np.random.default_rng(2).integers(0, 256, (10, 12), np.uint8), np.ones((5, 5), np.uint8))
    image = ground[20:20 + height, 2 * index:2 * index + width].copy()
    image[90:140, 30 + 5 * index:90 + 5 * index] = block
    return np.repeat(image[:, :, None], 3, axis=2)


def image_message(index: int, frame_id: str = 'front') -> Image:
    """``picture(index)`` at 10 Hz; the first stamp is 0.1 s."""
    return image_to_msg(picture(index), header_of((index + 1) * 100_000_000, frame_id))


def ready(peer: Peer, topic: str, count: int = 1) -> bool:
    """True once ``count`` subscriptions are on a topic and have found this peer's publisher."""
    found = peer.until(lambda: peer.node.count_subscribers(topic) >= count)
    peer.until(lambda: False, MATCHING_S)
    return found
