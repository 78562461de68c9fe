"""``overlay``: image_raw + detections, flow -> pictures for people, only when someone looks."""

from __future__ import annotations

import time
from typing import Any

from motion_detect_ros.bridge.images import stamp_ns
from motion_detect_ros.bridge.managed_node import ManagedNode
from motion_detect_ros.bridge.params import declare_simple
from motion_detect_ros.bridge.qos import image_qos
from motion_detect_ros.bridge.runner import main_of
from motion_detect_ros.bridge.sync import ExactJoin
from motion_detect_ros.bridge.topics import (
    DETECTIONS,
    FLOW,
    FLOW_COLORS,
    IMAGE,
    OVERLAY,
    OVERLAY_JPEG,
    TopicPublisher,
)
from motion_detect_ros.core.drawing import draw_detections, flow_to_color
from motion_detect_ros.core.errors import MotionDetectError

#: How often it looks whether someone listens, seconds; images that may wait for their detections.
LOOK_PERIOD_S = 0.5
WAITING = 10


class OverlayNode(ManagedNode):
    """Draws boxes, ids and velocities, and flow as colour."""

    def __init__(self) -> None:
        super().__init__('overlay')
        self._reliability = str(declare_simple(
            self, 'image_reliability', 'reliable', 'reliability asked of image publishers',
            choices=('reliable', 'best_effort')))
        self._join = ExactJoin(('image', 'detections'), WAITING)
        self._drops = 0
        self._watching: tuple[bool, bool] = (False, False)
        self._active = False
        self.create_timer(LOOK_PERIOD_S, self._look)

    def open(self) -> None:
        """Publishers; ``~/overlay/compressed`` is JPEG."""
        self._overlay = TopicPublisher(self, OVERLAY)
        self._jpeg = TopicPublisher(self, OVERLAY_JPEG)
        self._colors = TopicPublisher(self, FLOW_COLORS)

    def begin(self) -> None:
        """Work when someone looks."""
        self._active = True

    def end(self) -> None:
        """Listen to nothing."""
        self._active, self._watching = False, (False, False)

    def reset(self) -> None:
        """Forget images that wait."""
        self._join.clear()

    def _look(self) -> None:
        if not self._active:
            return
        wanted = (self._overlay.listeners + self._jpeg.listeners > 0, self._colors.listeners > 0)
        if wanted == self._watching:
            return
        self.unsubscribe()
        self._watching = wanted
        quality = image_qos(self._reliability)
        if wanted[0]:
            self.subscribe(IMAGE.kind, IMAGE.name, lambda msg: self._on_input('image', msg), quality)
            self.subscribe(DETECTIONS.kind, DETECTIONS.name, lambda msg: self._on_input('detections', msg),
                           DETECTIONS.qos())
        if wanted[1]:
            self.subscribe(FLOW.kind, FLOW.name, self._on_flow, quality)

    def _on_input(self, name: str, msg: Any) -> None:
        if name == 'image':
            self.stats.count_received(time.monotonic_ns())
        messages = self._join.add(name, stamp_ns(msg.header), msg)
        self._count_drops()
        if not messages:
            return
        try:
            self._draw(*messages)
        except MotionDetectError as error:
            self.bad_input(error)

    def _draw(self, image: Any, detections: Any) -> None:
        start = time.perf_counter()
        picture = draw_detections(IMAGE.from_msg(image), DETECTIONS.from_msg(detections))
        for publisher in (self._overlay, self._jpeg):
            if publisher.listeners:
                publisher.publish(picture, image.header)
        latency_ms = 1e3 * (time.perf_counter() - start)
        self.stats.count_processed(time.monotonic_ns(), latency_ms, (self.now_ns() - stamp_ns(image.header)) / 1e6)

    def _count_drops(self) -> None:
        if self._join.dropped > self._drops:
            self.stats.count_dropped(self._join.dropped - self._drops)
            self._drops = self._join.dropped

    def _on_flow(self, msg: Any) -> None:
        try:
            self._colors.publish(flow_to_color(FLOW.from_msg(msg).flow), msg.header)
        except MotionDetectError as error:
            self.bad_input(error)


main = main_of(OverlayNode)

if __name__ == '__main__':
    main()
