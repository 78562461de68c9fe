"""``overlay``: image_raw + detections, flow -> pictures for people, only when someone looks."""

from __future__ import annotations

import time

from sensor_msgs.msg import CompressedImage, Image, PointCloud2

from motion_detect_ros.bridge.images import compressed_to_msg, flow_from_msg, image_from_msg, image_to_msg, stamp_ns
from motion_detect_ros.bridge.managed_node import ManagedNode
from motion_detect_ros.bridge.params import declare_simple
from motion_detect_ros.bridge.qos import image_qos, overridable, record_qos
from motion_detect_ros.bridge.records import read_detections
from motion_detect_ros.bridge.runner import main_of
from motion_detect_ros.bridge.sync import ExactJoin
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
        self._watching: tuple[bool, bool] = (False, False)
        self._active = False

    def open(self) -> None:
        """Publishers; ``~/overlay/compressed`` is JPEG."""
        options = {'qos_overriding_options': overridable()}
        self._overlay = self.create_lifecycle_publisher(Image, '~/overlay', image_qos(), **options)
        self._jpeg = self.create_lifecycle_publisher(
            CompressedImage, '~/overlay/compressed', image_qos(), **options)
        self._colors = self.create_lifecycle_publisher(Image, '~/flow', image_qos(), **options)
        self.create_timer(LOOK_PERIOD_S, self._look)

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
        boxes = self._overlay.get_subscription_count() + self._jpeg.get_subscription_count() > 0
        wanted = (boxes, self._colors.get_subscription_count() > 0)
        if not self._active or wanted == self._watching:
            return
        self.close()
        self._active, self._watching = True, wanted
        quality = image_qos(self._reliability)
        if wanted[0]:
            self.subscribe(Image, 'image_raw', lambda msg: self._on_input('image', msg), quality)
            self.subscribe(PointCloud2, 'detections', lambda msg: self._on_input('detections', msg), record_qos())
        if wanted[1]:
            self.subscribe(Image, 'flow', self._on_flow, quality)

    def _on_input(self, name: str, msg: Image | PointCloud2) -> None:
        self.stats.count_received(time.monotonic_ns())
        messages = self._join.add(name, stamp_ns(msg.header), msg)
        if not messages:
            return
        image, detections = messages
        try:
            picture = draw_detections(image_from_msg(image), read_detections(detections))
            if self._overlay.get_subscription_count():
                self._overlay.publish(image_to_msg(picture, image.header))
            if self._jpeg.get_subscription_count():
                self._jpeg.publish(compressed_to_msg(picture, image.header))
            self.stats.count_processed(time.monotonic_ns(), 0.0, 0.0)
        except MotionDetectError as error:
            self.bad_input(error)

    def _on_flow(self, msg: Image) -> None:
        try:
            field = flow_from_msg(msg, msg.width, msg.height)
            self._colors.publish(image_to_msg(flow_to_color(field.flow), msg.header))
        except MotionDetectError as error:
            self.bad_input(error)


main = main_of(OverlayNode)

if __name__ == '__main__':
    main()
