"""A camera for measurements: pictures at a fixed rate, latency of their detections, and the nodes' diagnostics."""

from __future__ import annotations

import itertools
import threading
import time
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import numpy.typing as npt
import rclpy
from rclpy.context import Context
from rclpy.executors import ExternalShutdownException, SingleThreadedExecutor
from rclpy.parameter import Parameter
from rclpy.parameter_client import AsyncParameterClient

from motion_detect_ros.bridge import transport
from motion_detect_ros.bridge.images import header_of, stamp_ns
from motion_detect_ros.bridge.topics import DETECTIONS, DIAGNOSTICS, IMAGE

#: How long detections of the last pictures may take, seconds.
ANSWER_TIMEOUT_S = 3.0
#: So many pictures' times of sending are remembered.
SENT_KEPT = 1000


@dataclass(frozen=True)
class Answer:
    """``stamp_ns``: of the picture, the moment before it was published where the clock was not shifted; ``latency_ms``:
    from that moment until its detections came; ``sent_s``: that moment, ``time.monotonic``.
    """

    stamp_ns: int
    latency_ms: float
    sent_s: float


class Feeder:
    """Publishes ``image_raw``, subscribes to ``detections`` and ``/diagnostics``; use as a context manager.

    Its process gets the shipped transport, as a camera node has it.

    images: (H, W) or (H, W, 3) uint8 each, played forward and backward in turn, so that the motion stays smooth.
    """

    def __init__(self, domain_id: int, images: Sequence[npt.NDArray[np.uint8]], rate_hz: float) -> None:
        self._images, self._rate_hz = images, rate_hz
        transport.use_here()
        self._context = Context()
        rclpy.init(context=self._context, domain_id=domain_id)
        self._node = rclpy.create_node('feeder', context=self._context)
        self._publishing = threading.Lock()
        self._publisher = self._node.create_publisher(IMAGE.kind, IMAGE.name, IMAGE.qos())
        self._shift_ns = 0
        self._sent_s: dict[int, float] = {}
        self._parameters: dict[str, AsyncParameterClient] = {}
        self._node.create_subscription(DETECTIONS.kind, DETECTIONS.name, self._on_detections, 100)
        self._node.create_subscription(DIAGNOSTICS.kind, DIAGNOSTICS.name, self._on_diagnostics, DIAGNOSTICS.qos())
        self._executor = SingleThreadedExecutor(context=self._context)
        self._executor.add_node(self._node)
        self._lock = threading.Lock()
        self._answers: list[Answer] = []
        self._diagnostics: dict[str, dict[str, str]] = {}
        self._stopped = threading.Event()
        self._threads = [threading.Thread(target=work, daemon=True) for work in (self._spin, self._feed)]
        self._feeding = threading.Event()
        self._sent = 0

    def __enter__(self) -> Feeder:
        for thread in self._threads:
            thread.start()
        return self

    def __exit__(self, *_: object) -> None:
        self._stopped.set()
        self._feeding.set()
        self._threads[1].join(ANSWER_TIMEOUT_S)
        self._executor.shutdown(timeout_sec=2.0)
        self._node.destroy_node()
        rclpy.try_shutdown(context=self._context)
        self._threads[0].join(ANSWER_TIMEOUT_S)

    def go(self) -> None:
        """Publish from now on."""
        self._feeding.set()

    def pause(self) -> None:
        """Publish nothing until ``go``."""
        self._feeding.clear()

    def shift(self, seconds: float) -> None:
        """The camera's clock steps by so much."""
        self._shift_ns += round(1e9 * seconds)

    def reconnect(self) -> None:
        """The camera's driver starts anew: another publisher."""
        with self._publishing:
            self._node.destroy_publisher(self._publisher)
            self._publisher = self._node.create_publisher(IMAGE.kind, IMAGE.name, IMAGE.qos())

    def set_parameter(self, node: str, name: str, value: bool | int | float | str) -> None:
        """Ask a node to change a parameter; the answer is not awaited."""
        if node not in self._parameters:
            self._parameters[node] = AsyncParameterClient(self._node, node)
        self._parameters[node].set_parameters([Parameter(name, value=value)])

    @property
    def subscribers(self) -> int:
        """Subscriptions matched with the publisher of the pictures."""
        return int(self._publisher.get_subscription_count())

    @property
    def nodes(self) -> list[str]:
        """Names of the nodes in the graph."""
        return list(self._node.get_node_names())

    @property
    def sent(self) -> int:
        """Pictures published so far."""
        return self._sent

    def take(self) -> list[Answer]:
        """Those of the detections received since the last call."""
        with self._lock:
            taken, self._answers = self._answers, []
        return taken

    def diagnostics(self, node: str) -> dict[str, str]:
        """The latest report of a node, key -> value; empty before the first."""
        with self._lock:
            return dict(self._diagnostics.get(f'/{node}', {}))

    def _spin(self) -> None:
        try:
            self._executor.spin()
        except ExternalShutdownException:
            return

    def _feed(self) -> None:
        order = [*range(len(self._images)), *range(len(self._images) - 2, 0, -1)]
        due_s = time.monotonic()
        for index in itertools.cycle(order):
            if not self._feeding.is_set():
                self._feeding.wait()
                due_s = time.monotonic()
            if self._stopped.wait(max(0.0, due_s - time.monotonic())):
                return
            self._publish(self._images[index])
            due_s = max(due_s + 1.0 / self._rate_hz, time.monotonic() - 1.0 / self._rate_hz)

    def _publish(self, image: npt.NDArray[np.uint8]) -> None:
        stamp = time.time_ns() + self._shift_ns
        with self._lock:
            self._sent_s[stamp] = time.monotonic()
            while len(self._sent_s) > SENT_KEPT:
                self._sent_s.pop(next(iter(self._sent_s)))
        with self._publishing:
            self._publisher.publish(IMAGE.to_msg(image, header_of(stamp, 'camera')))
        self._sent += 1

    def _on_detections(self, msg: Any) -> None:
        now_s, stamp = time.monotonic(), stamp_ns(msg.header)
        with self._lock:
            sent_s = self._sent_s.get(stamp)
            if sent_s is not None:
                self._answers.append(Answer(stamp, 1e3 * (now_s - sent_s), sent_s))

    def _on_diagnostics(self, msg: Any) -> None:
        with self._lock:
            for status in msg.status:
                self._diagnostics[status.name] = {pair.key: pair.value for pair in status.values}
