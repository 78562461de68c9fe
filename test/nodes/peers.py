"""A peer of the nodes over DDS, as a user's node would be, and what it publishes to them."""

from __future__ import annotations

import time
from collections import Counter
from collections.abc import Callable, Sequence
from typing import Any

import numpy as np
import rclpy
from diagnostic_msgs.msg import DiagnosticArray
from rcl_interfaces.srv import GetParameters, SetParameters
from rclpy.context import Context
from rclpy.executors import SingleThreadedExecutor
from rclpy.parameter import Parameter
from rclpy.qos import QoSProfile, QoSReliabilityPolicy
from sensor_msgs.msg import Image

from motion_detect_ros.bridge.images import header_of, image_to_msg, stamp_ns
from motion_detect_ros.cli.live import depth_of, queues

#: A safety net: three nodes that share a busy core take a minute to start.
TIMEOUT_S = 300.0
#: For the last messages of nodes that are at work already: a lost one is sent again every three seconds.
ALL_CAME_S = 60.0
#: After this an answer is asked for again: a server that has not found the client yet drops the first one.
ASK_AGAIN_S = 5.0
#: Messages that may wait in publishers and subscriptions where none may be lost.
DEEP = 1000
#: What stages count of their images, in diagnostics.
COUNTED = {'received', 'processed', 'dropped', 'stamps_seen', 'stamps_late', 'stamps_jump'}


def own_lines(printed: str) -> list[str]:
    """What a node printed without the lines of the transport.

    Fast DDS complains on standard error where a port of its shared memory is taken by a process of another domain, and
    goes on with the next one.
    """
    return [line for line in printed.splitlines() if 'RTPS_TRANSPORT' not in line]


class Peer:
    """A node of our own in this process."""

    def __init__(self, domain_id: int, namespace: str = '') -> None:
        self._context = Context()
        rclpy.init(context=self._context, domain_id=domain_id)
        self.node = rclpy.create_node('peer', context=self._context, namespace=namespace)
        self._executor = SingleThreadedExecutor(context=self._context)
        self._executor.add_node(self.node)
        self._received: dict[str, list[Any]] = {}
        self._publishers: dict[str, Any] = {}

    def subscribe(self, kind: Any, topic: str, depth: int = 100) -> list[Any]:
        """Messages of a topic, as they come."""
        received = self._received.setdefault(topic, [])
        self.node.create_subscription(kind, topic, received.append, depth)
        return received

    def advertise(self, kind: Any, topic: str, *, best_effort: bool = False) -> Any:
        """A publisher."""
        reliability = QoSReliabilityPolicy.BEST_EFFORT if best_effort else QoSReliabilityPolicy.RELIABLE
        publisher = self.node.create_publisher(kind, topic, QoSProfile(depth=DEEP, reliability=reliability))
        self._publishers[topic] = publisher
        return publisher

    def until(self, condition: Callable[[], object], timeout_s: float = TIMEOUT_S) -> bool:
        """Spins until ``condition`` holds; False where it never does."""
        deadline = time.monotonic() + timeout_s
        while not condition():
            if time.monotonic() > deadline:
                return False
            self._executor.spin_once(timeout_sec=0.05)
        return True

    def rest(self, seconds: float) -> None:
        """Spins for so long, for what must not come."""
        self.until(lambda: False, seconds)

    def call(self, kind: Any, service: str, **request: Any) -> Any:
        """The answer of a service of a node, asked once."""
        client = self.node.create_client(kind, service)
        assert self.until(client.service_is_ready), service
        self.known_to(service.rpartition('/')[0])
        answer = client.call_async(kind.Request(**request))
        assert self.until(answer.done), service
        self.node.destroy_client(client)
        return answer.result()

    def known_to(self, node: str) -> None:
        """Returns once ``node`` has found every publisher, subscription and client that this peer has by now.

        Endpoints are announced in the order in which they are made, and a node answers a client that it has found: its
        answer to a new client proves that it has found the older endpoints.
        """
        client = self.node.create_client(GetParameters, f'{node}/get_parameters')
        assert self.until(client.service_is_ready), node
        answers = []

        def answered() -> bool:
            answers.append(client.call_async(GetParameters.Request()))
            return self.until(lambda: any(answer.done() for answer in answers), ASK_AGAIN_S)

        assert self.until(answered), node
        self.node.destroy_client(client)

    def matched(self, topic: str, count: int) -> bool:
        """True once the publisher of ``topic`` has ``count`` subscriptions whose nodes are known by name."""
        publisher = self._publishers[topic]
        return self.until(lambda: publisher.get_subscription_count() >= count
                          and len(self.subscribed(topic)) >= count)

    def subscribed(self, topic: str) -> list[str]:
        """The other nodes that subscribe to a topic, with their namespaces."""
        name = self._publishers[topic].topic_name
        found = [(info.node_namespace, info.node_name) for info in self.node.get_subscriptions_info_by_topic(name)]
        return [f'{namespace.rstrip("/")}/{node}' for namespace, node in found
                if node not in {'_NODE_NAME_UNKNOWN_', self.node.get_name()}]

    def sees(self, topic: str) -> str:
        """In words for a failure: how many subscriptions of a topic are found, whose they are, and which nodes."""
        return (f'{topic}: {self._publishers[topic].get_subscription_count()} found, of {self.subscribed(topic)}; '
                f'nodes: {self.node.get_node_names_and_namespaces()}')

    def close(self) -> None:
        """Leave the graph."""
        self._executor.shutdown(timeout_sec=2.0)
        self.node.destroy_node()
        rclpy.try_shutdown(context=self._context)


def all_came(peer: Peer, received: Sequence[Any], stamps_ns: Sequence[int], timeout_s: float = ALL_CAME_S) -> None:
    """Asserts that messages of these stamps come, each once and in this order; else says which did, and what is wrong.

    For topics whose publisher is ``lossless``: others overwrite what a busy machine is late to take.
    """
    peer.until(lambda: len(received) >= len(stamps_ns), timeout_s)
    came = [stamp_ns(message.header) for message in received]
    missing, extra = Counter(stamps_ns) - Counter(came), Counter(came) - Counter(stamps_ns)
    assert came == [*stamps_ns], (
        f'came: {came}; missing: {sorted(missing.elements())}; too many: {sorted(extra.elements())}')


def set_parameters(peer: Peer, node: str, **values: Any) -> list[str]:
    """Sets parameters of a node one by one, ``__`` for points; the reasons why not, empty where they were set."""
    given = [Parameter(name.replace('__', '.'), value=value).to_parameter_msg() for name, value in values.items()]
    return [result.reason for result in peer.call(SetParameters, f'/{node}/set_parameters', parameters=given).results]


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
    """True once ``count`` nodes subscribe to a topic, and they and this peer have found all of each other; else it says
    what this peer has found."""
    assert peer.matched(topic, count), peer.sees(topic)
    for node in set(peer.subscribed(topic)):
        peer.known_to(node)
    return True


def found_each_other(
    peer: Peer, nodes: Sequence[str], reports: list[DiagnosticArray], answers: list[Any], send: Callable[[int], None],
    cycle: int = 1,
) -> int:
    """How many images it took until stages as separate nodes answered, idle again: the first ones may be lost.

    reports: of /diagnostics, the latest stay; send: publishes the image of that number; cycle: as many at a time.
    """
    sent = 0

    def answered() -> bool:
        nonlocal sent
        for number in range(sent, sent + cycle):
            send(number)
        sent += cycle
        peer.rest(0.1)
        return bool(answers)

    def of(node: str) -> list[dict[str, str]]:
        return [{pair.key: pair.value for pair in message.status[0].values if pair.key in COUNTED}
                for message in reports if message.status[0].name == f'/{node}']

    def idle() -> bool:
        """Three reports of each that say the same."""
        reports.clear()
        assert peer.until(lambda: all(len(of(node)) >= 3 for node in nodes))
        return all(of(node)[0] == (last := of(node)[-1]) and last['received'] == str(sent) for node in nodes)

    assert peer.until(answered)
    assert peer.until(idle)
    return sent


def lossless(*topics: str) -> list[str]:
    """ROS arguments under which nothing on ``topics`` is overwritten before it is taken."""
    return [word for topic in topics for setting in depth_of(topic, DEEP) for word in ('-p', setting)]


#: Every image is answered, however late: for stages, and for the player that feeds them.
PATIENT = queues(DEEP)
