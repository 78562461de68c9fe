"""``camera``: a webcam, video, stream or image folder -> image_raw, camera_info."""

from __future__ import annotations

import time
from typing import Any

from motion_detect_ros.bridge.calibration_url import calibration_at, info_of_image
from motion_detect_ros.bridge.diagnostics import Condition, silent
from motion_detect_ros.bridge.images import header_of
from motion_detect_ros.bridge.managed_node import WARNING_PERIOD_S
from motion_detect_ros.bridge.params import declare_address, declare_simple
from motion_detect_ros.bridge.runner import main_of
from motion_detect_ros.bridge.source_node import SourceNode
from motion_detect_ros.bridge.topics import CAMERA_INFO, COMPRESSED, IMAGE, TopicPublisher
from motion_detect_ros.core.errors import MessageError, MotionDetectError
from motion_detect_ros.core.types import ByteArray
from motion_detect_ros.sources.capture import Capture
from motion_detect_ros.sources.frames import CAMERA_FRAME, SourceFrame
from motion_detect_ros.sources.secrets import masked, with_secret

#: Longest wait for a picture before looking whether to stop, seconds.
READ_TIMEOUT_S = 0.2
#: A camera may take so long until its first picture, seconds.
STARTING_S = 2.0


class CameraNode(SourceNode):
    """Publishes pictures as they come, late ones left out, and warns when it falls behind."""

    #: Of the present activation.
    _capture: Capture

    def __init__(self) -> None:
        super().__init__('camera')
        address = declare_address(self, 'source', '0', 'camera (0, /dev/video0), file, folder, bag, rtsp:// or http://')
        secret_file = str(declare_simple(self, 'source_secret_file', '', 'file with user:password, or the address'))
        self._source = with_secret(address, secret_file)
        self._fps = float(declare_simple(self, 'fps', 0.0, 'rate of a source without stamps, 0 = its own', 0.0, 1000.0))
        self._topic = str(declare_simple(self, 'topic', '', 'image topic of a bag, needed where it has several'))
        self._frame_id = str(declare_simple(self, 'frame_id', CAMERA_FRAME, 'frame of the optical axis'))
        self._keep = int(declare_simple(self, 'decimation_keep', 1, 'use the first so many ...', 1, 1000))
        self._of = int(declare_simple(self, 'decimation_of', 1, '... of every so many pictures', 1, 1000))
        self._queue_size = int(declare_simple(self, 'queue_size', 2, 'pictures that may wait', 1, 1000))
        self._realtime = bool(declare_simple(self, 'realtime', True, 'play files at their own pace, drop late ones'))
        url = str(declare_simple(
            self, 'camera_info_url', '', 'calibration of the images, file:// or package://; empty = of the source'))
        self._calibration = calibration_at(url) if url else None
        self._drops = 0
        self._began_s = 0.0
        self._lost = False

    def open(self) -> None:
        """Publishers; JPEG only while someone subscribes to it."""
        self._images = TopicPublisher(self, IMAGE)
        self._jpegs = TopicPublisher(self, COMPRESSED)
        self._infos = TopicPublisher(self, CAMERA_INFO)

    def prepare(self) -> None:
        """Open the device."""
        self._capture = self.unless_stopped(lambda: Capture(
            self._source, self._fps or None, self._keep, self._of, self._queue_size, self._realtime,
            self._topic or None))
        self._drops, self._began_s, self._lost = 0, time.monotonic(), False
        self.get_logger().info(f'opened {masked(self._source)}')

    def produce(self) -> None:
        """Capture and publish until the source ends."""
        capture = self._capture
        try:
            capture.warm_up()
            self.await_subscribers((self._images.publisher, self._jpegs.publisher))
            self._began_s = time.monotonic()
            if not self.stopped.is_set():
                capture.start()
            while not self.stopped.is_set():
                frame = capture.read(READ_TIMEOUT_S)
                if frame is not None:
                    self._publish(frame)
                elif capture.ended:
                    return
        finally:
            if capture.damage:
                self.get_logger().warning(f'{masked(self._source)}: {capture.damage}')
            capture.close()
            if capture.blocked and self.context.ok():
                self.get_logger().warning(
                    f'{masked(self._source)}: the driver does not answer and keeps the device until then')

    def condition(self) -> Condition:
        """A camera that gives no pictures has failed; one whose pictures are dropped is too fast for us."""
        idle = super().condition()
        if idle.idle:
            return idle
        concern = 'slower than the camera' if self._capture.stats.behind else self._capture.damage
        starting = time.monotonic() - self._began_s < STARTING_S
        silence = '' if starting else silent(self.stats.summary(time.monotonic_ns()))
        fault = ': '.join(filter(None, (silence, self._capture.trouble))) if silence else ''
        if bool(fault) != self._lost:
            self._lost = bool(fault)
            self.get_logger().warning(f'{masked(self._source)}: {fault or "pictures come again"}')
        return Condition(fault, concern)

    def extra_diagnostics(self) -> tuple[tuple[str, str], ...]:
        """Counts of the capture, and how often a stream was opened anew."""
        stats = vars(self._capture.stats) if self.active else {}
        return tuple((key if key == 'reconnects' else f'capture_{key}', str(value)) for key, value in stats.items())

    def _publish(self, frame: SourceFrame) -> None:
        start = time.perf_counter()
        self.stats.count_received(time.monotonic_ns())
        try:
            header = header_of(frame.stamp_ns, self._frame_id)
            self._infos.publish(self._info(frame.image, header))
            self._images.publish(frame.image, header)
        except MotionDetectError as error:
            self.bad_input(error)
            return
        self._compress(frame.image, header)
        latency_ms = 1e3 * (time.perf_counter() - start)
        self.stats.count_processed(time.monotonic_ns(), latency_ms, (self.now_ns() - frame.stamp_ns) / 1e6)
        self._count_drops()
        if self._capture.stats.behind:
            self.get_logger().warning('processing is slower than the camera: pictures are dropped',
                                      throttle_duration_sec=WARNING_PERIOD_S)

    def _compress(self, image: ByteArray, header: Any) -> None:
        try:
            if self._jpegs.subscribers:
                self._jpegs.publish(image, header)
        except MessageError as error:
            self.stats.count_error(str(error))
            self.get_logger().warning(f'{self._jpegs.publisher.topic_name}: {error}', once=True)

    def _info(self, image: ByteArray, header: Any) -> Any:
        info, complaint = info_of_image(self._calibration or self._capture.calibration, image, header)
        if complaint:
            self.get_logger().warning(complaint, once=True)
        return info

    def _count_drops(self) -> None:
        dropped = self._capture.stats.dropped
        self.stats.count_dropped(dropped - self._drops)
        self._drops = dropped


main = main_of(CameraNode)

if __name__ == '__main__':
    main()
