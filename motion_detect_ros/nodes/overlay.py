"""``overlay``: image_raw + detections, flow -> pictures and markers for people, only while someone subscribes."""

from __future__ import annotations

import time
from collections.abc import Callable
from typing import Any

from motion_detect_ros.bridge.diagnostics import Condition
from motion_detect_ros.bridge.image_input import ImageInput
from motion_detect_ros.bridge.images import image_from_msg, stamp_ns
from motion_detect_ros.bridge.managed_node import ManagedNode
from motion_detect_ros.bridge.markers import MarkerWriter
from motion_detect_ros.bridge.params import declare_simple
from motion_detect_ros.bridge.qos import image_qos
from motion_detect_ros.bridge.runner import main_of
from motion_detect_ros.bridge.sync import ExactJoin, size_of
from motion_detect_ros.bridge.topics import (
    CAMERA_INFO,
    DETECTIONS,
    FLOW,
    FLOW_COLORS,
    MARKERS,
    OVERLAY,
    OVERLAY_JPEG,
    Topic,
    TopicPublisher,
)
from motion_detect_ros.core.drawing import draw_detections, flow_to_color
from motion_detect_ros.core.stamp_order import REORDER_S
from motion_detect_ros.core.types import FlowField
from motion_detect_ros.sources.encoding import ImageDecoder

#: How often its subscribers are counted, seconds; images that may wait for their detections, however large.
DEMAND_PERIOD_S, WAITING = 0.5, 10


class OverlayNode(ManagedNode):
    """Draws boxes, ids and velocities, flow as colour, and bearings as markers."""

    def __init__(self) -> None:
        super().__init__('overlay')
        self._image_input = ImageInput.declared(self)
        self._join = ExactJoin(('image', 'detections'), WAITING, REORDER_S, size_of)
        self._markers = MarkerWriter(float(declare_simple(
            self, 'box_distance_m', 0.0, 'distance at which ~/markers has boxes too, 0 = none', 0.0, 1000.0)),
            self._image_input.rectified)
        self._decoder, self._inputs = ImageDecoder(), tuple[Topic, ...]()
        self.every(DEMAND_PERIOD_S, self._follow_demand)

    def open(self) -> None:
        """Publishers; ``~/overlay/compressed`` is JPEG."""
        self._overlay, self._jpeg = TopicPublisher(self, OVERLAY), TopicPublisher(self, OVERLAY_JPEG)
        self._colors = TopicPublisher(self, FLOW_COLORS)
        self._rays = TopicPublisher(self, MARKERS)

    def end(self) -> None:
        """Subscribe to nothing."""
        self._inputs = ()
        self._join.clear()

    def reset(self) -> None:
        """Forget images that wait."""
        self._join.clear()

    def condition(self) -> Condition:
        """Idle without subscribers, or while what is to be shown does not exist yet."""
        names = [topic.name for topic in self._inputs]
        if gone := self.gone(names):
            return Condition(concern=gone)
        absent = [name for name in names if not self.count_publishers(self.resolve_topic_name(name))]
        waits = f'no publisher of {", ".join(absent)} yet' if absent else ''
        return Condition(idle=waits if self._inputs else 'no subscribers')

    def _follow_demand(self) -> None:
        if not self.active:
            return
        if not self._rays.subscribers:
            self._markers.clear()
        wanted = self._wanted()
        if wanted == self._inputs:
            return
        self.unsubscribe()
        self._join.clear()
        self._inputs = wanted
        quality, relax = image_qos(self._image_input.reliability), self._image_input.relaxes
        if self._image_input.topic in wanted:
            self.subscribe(self._image_input.topic.kind, self._image_input.topic.name, self._on_image, quality, relax)
        if DETECTIONS in wanted:
            self.subscribe(DETECTIONS.kind, DETECTIONS.name, self._on_detections, DETECTIONS.qos())
            self.subscribe(CAMERA_INFO.kind, CAMERA_INFO.name, self._markers.use_camera, quality, relax)
        if FLOW in wanted:
            self.subscribe(FLOW.kind, FLOW.name, self._on_flow, quality)

    def _wanted(self) -> tuple[Topic, ...]:
        pictures = self._overlay.subscribers + self._jpeg.subscribers > 0
        return tuple(topic for topic, wanted in (
            (self._image_input.topic, pictures), (DETECTIONS, pictures or self._rays.subscribers > 0),
            (FLOW, self._colors.subscribers > 0)) if wanted)

    def _on_image(self, msg: Any) -> None:
        self.stats.count_received(time.monotonic_ns())
        self._join_with('image', msg)

    def _on_detections(self, msg: Any) -> None:
        if self._image_input.topic in self._inputs:
            self._join_with('detections', msg)
        if self._rays.subscribers:
            self.stats.count_received(time.monotonic_ns())
            self._show(lambda: self._rays.publish(self._markers.message(DETECTIONS.from_msg(msg), msg.header)), msg)

    def _on_flow(self, msg: Any) -> None:
        self.stats.count_received(time.monotonic_ns())
        self._show(lambda: self._color(FLOW.from_msg(msg), msg.header), msg)

    def _color(self, field: FlowField, header: Any) -> None:
        if field.measured:
            self._colors.publish(flow_to_color(field.flow), header)

    def _join_with(self, name: str, msg: Any) -> None:
        messages = self._join.add(name, stamp_ns(msg.header), msg)
        unanswered = sum('detections' not in items for items in self._join.given_up)  # the detector says why
        self.stats.count_left_out(unanswered)
        self.stats.count_dropped(len(self._join.given_up) - unanswered)
        self.stats.count_dropped(name == 'image' and not self._join.verdict.usable)
        if messages:
            self._show(lambda: self._draw(*messages), messages[0])

    def _draw(self, image: Any, detections: Any) -> None:
        picture = draw_detections(image_from_msg(image, self._decoder), DETECTIONS.from_msg(detections))
        for publisher in (each for each in (self._overlay, self._jpeg) if each.subscribers):
            publisher.publish(picture, image.header)

    def _show(self, action: Callable[[], None], msg: Any) -> None:
        """Runs ``action`` on what ``msg`` brought; an input that cannot be shown costs itself only."""
        start = time.perf_counter()
        try:
            action()
        except Exception as error:  # whatever it is, the next picture may be in order
            self.bad_input(error)
            return
        latency_ms, age_ms = 1e3 * (time.perf_counter() - start), (self.now_ns() - stamp_ns(msg.header)) / 1e6
        self.stats.count_processed(time.monotonic_ns(), latency_ms, age_ms)


main = main_of(OverlayNode)

if __name__ == '__main__':
    main()
