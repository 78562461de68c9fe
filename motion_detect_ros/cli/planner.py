"""A subscriber as a planner has it: every detections message, with the time it took from the image."""

from __future__ import annotations

import math
import threading
import time
from collections.abc import Callable, Collection, Mapping
from dataclasses import dataclass, replace
from typing import Any

import rclpy
from rclpy.context import Context
from rclpy.executors import ExternalShutdownException, SingleThreadedExecutor

from motion_detect_ros.bridge.diagnostics import COUNTERS, SUBSCRIBERS_OF
from motion_detect_ros.bridge.images import stamp_ns
from motion_detect_ros.bridge.topics import CLOCK, DETECTIONS, DIAGNOSTICS
from motion_detect_ros.bridge.trigger import TriggerClient
from motion_detect_ros.core.types import RecordArray
from motion_detect_ros.sources.frames import CAMERA_FRAME


@dataclass(frozen=True)
class Received:
    """One detections message. ``latency_ms``: since the image of the same stamp was published, NaN if unknown;
    ``frame_id``: of its header.
    """

    stamp_ns: int
    records: RecordArray
    latency_ms: float
    frame_id: str = CAMERA_FRAME


class Planner:
    """Listens in a thread with a context of its own; use as a context manager.

    The player shows on ``/clock`` when an image was recorded just before it publishes the image: that is where latency
    counts from. Which image that is, ``expect`` tells, as the stamp of an image is not the time of its recording.
    A tick counts from its arrival as the middleware noted it, as a thread that runs late handles it late, or after the
    answer; an answer counts when it is handled.
    """

    def __init__(self, domain_id: int, namespace: str = '') -> None:
        self._context = Context()
        rclpy.init(context=self._context, domain_id=domain_id)
        self._node = rclpy.create_node('planner', namespace=namespace, context=self._context)
        self._node.create_subscription(DETECTIONS.kind, DETECTIONS.name, self._on_detections, 100)
        self._node.create_subscription(CLOCK.kind, CLOCK.name, self._on_clock, CLOCK.qos())
        self._node.create_subscription(DIAGNOSTICS.kind, DIAGNOSTICS.name, self._on_diagnostics, DIAGNOSTICS.qos())
        self._executor = SingleThreadedExecutor(context=self._context)
        self._executor.add_node(self._node)
        self._changed = threading.Condition()
        self._clock_of: dict[int, int] = {}
        self._shown_ns: dict[int, int] = {}
        self._received: list[tuple[Received, int]] = []  # and when each was handled, ns
        self._found: dict[str, dict[str, int]] = {}
        self._counters: dict[str, dict[str, int]] = {}
        self._place_at: dict[int, int] = {}
        self._place_of: dict[int, int] = {}
        self._shown = self._answered = 0
        #: Called after each tick of the clock and each answer, in the planner's thread.
        self.watch: Callable[[], None] = lambda: None
        self._thread = threading.Thread(target=self._spin, name='planner', daemon=True)

    def __enter__(self) -> Planner:
        self._thread.start()
        return self

    def __exit__(self, *_: object) -> None:
        self._executor.shutdown(timeout_sec=2.0)
        self._node.destroy_node()
        rclpy.try_shutdown(context=self._context)
        self._thread.join(5.0)

    @property
    def received(self) -> list[Received]:
        """Everything so far, in the order of arrival."""
        with self._changed:
            return [replace(message, latency_ms=self._since_image_ms(message.stamp_ns, arrived_ns))
                    for message, arrived_ns in self._received]

    @property
    def answers(self) -> int:
        """How many have come so far."""
        with self._changed:
            return len(self._received)

    @property
    def backlog(self) -> int:
        """Images that the player has published after the latest one with an answer, of those that are to get one."""
        with self._changed:
            return max(0, self._shown - self._answered)

    @property
    def published(self) -> int:
        """Expected images that the player has published, or is about to."""
        with self._changed:
            return sum(clock_ns in self._shown_ns for clock_ns in self._clock_of.values())

    @property
    def expected(self) -> int:
        """Images that the player is to publish."""
        with self._changed:
            return len(self._clock_of)

    def expect(self, clock_of: Mapping[int, int], wanted: Collection[int] | None = None) -> None:
        """Forget what was received and get ready for other images: stamp -> what ``/clock`` shows before it, ns.

        wanted: stamps of those that are to be answered, None for all.
        """
        with self._changed:
            self._received.clear()
            self._shown_ns.clear()
            self._clock_of = dict(clock_of)
            asked = [stamp for stamp in clock_of if wanted is None or stamp in wanted]
            self._place_of = {stamp: place for place, stamp in enumerate(asked, 1)}
            self._place_at = {clock_of[stamp]: place for stamp, place in self._place_of.items()}
            self._shown = self._answered = 0

    def wait_for(self, count: int, timeout_s: float) -> bool:
        """True once ``count`` messages are there, False where they do not come in time."""
        with self._changed:
            return self._changed.wait_for(lambda: len(self._received) >= count, timeout_s)

    def service(self, name: str) -> TriggerClient:
        """A service of another node, by its full name; its answers come while the planner listens."""
        return TriggerClient(self._node, name)

    def counter(self, node: str, name: str) -> int | None:
        """What a node has last said in diagnostics that it has counted; None before it has."""
        with self._changed:
            return self._counters.get(node, {}).get(name)

    def subscribers_of(self, topic: str) -> int:
        """Subscriptions that the graph shows on a topic."""
        return int(self._node.count_subscribers(topic))

    def publishers_of(self, topic: str) -> int:
        """Publishers that the graph shows on a topic."""
        return int(self._node.count_publishers(topic))

    def connected(self, node: str) -> bool:
        """Whether a node has said that its publishers have found all subscriptions that the graph shows."""
        with self._changed:
            found = self._found.get(node, {})
        return bool(found) and all(count >= self.subscribers_of(topic) for topic, count in found.items())

    def _spin(self) -> None:
        try:
            self._executor.spin()
        except ExternalShutdownException:
            return

    def _since_image_ms(self, stamp: int, arrived_ns: int) -> float:
        clock_ns = self._clock_of.get(stamp)
        shown_ns = None if clock_ns is None else self._shown_ns.get(clock_ns)
        return math.nan if shown_ns is None else (arrived_ns - shown_ns) / 1e6

    def _on_clock(self, msg: Any, info: Mapping[str, int]) -> None:
        with self._changed:
            clock_ns = CLOCK.from_msg(msg)
            self._shown_ns[clock_ns] = info['received_timestamp']
            self._shown = max(self._shown, self._place_at.get(clock_ns, 0))
        self.watch()

    def _on_diagnostics(self, msg: Any) -> None:
        values = {status.name: {pair.key: pair.value for pair in status.values} for status in msg.status}
        with self._changed:
            for node, said in values.items():
                self._found[node] = {key.removeprefix(SUBSCRIBERS_OF): int(value) for key, value in said.items()
                                     if key.startswith(SUBSCRIBERS_OF)}
                self._counters[node] = {key: int(said[key]) for key in COUNTERS if key in said}

    def _on_detections(self, msg: Any) -> None:
        arrived_ns, stamp = time.time_ns(), stamp_ns(msg.header)  # by the clock of the middleware
        records = DETECTIONS.from_msg(msg)
        with self._changed:
            self._received.append((Received(stamp, records, math.nan, msg.header.frame_id), arrived_ns))
            self._answered = max(self._answered, self._place_of.get(stamp, 0))
            self._changed.notify_all()
        self.watch()
