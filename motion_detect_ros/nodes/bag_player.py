"""``bag_player``: plays an MCAP or db3 bag with its original stamps, and /clock."""

from __future__ import annotations

import threading
import time
from typing import Any

from motion_detect_ros.bridge.managed_node import ManagedNode
from motion_detect_ros.bridge.params import declare_simple
from motion_detect_ros.bridge.qos import image_qos, overridable, record_qos
from motion_detect_ros.bridge.runner import main_of
from motion_detect_ros.bridge.serialized import IMAGE_TYPES, header_stamp_ns, message_class
from motion_detect_ros.bridge.topics import CLOCK, TopicPublisher
from motion_detect_ros.core.errors import MessageError, SourceError
from motion_detect_ros.sources.bags import BagReader, RawMessage

#: How often it looks whether enough subscribers are there, how long others get to be found after them, and how long
#: the last message gets to leave, seconds.
POLL_S = 0.02
SETTLE_S = 0.5
LINGER_S = 0.5


class BagPlayerNode(ManagedNode):
    """Publishes the messages of a bag as they were recorded, at ``rate`` times the recorded speed."""

    def __init__(self) -> None:
        super().__init__('bag_player')
        self._bag = str(declare_simple(self, 'bag', '', 'MCAP or db3 file, or a folder that holds one'))
        self._rate = float(declare_simple(self, 'rate', 1.0, 'speed against the recording', 0.001, 1000.0))
        self._loop = bool(declare_simple(self, 'loop', False, 'start again at the end'))
        self._wait_for = int(declare_simple(
            self, 'wait_for_subscribers', 0, 'subscribers that every image topic must have before the start', 0, 100))
        if not self._bag:
            raise SourceError('bag_player: expected the parameter bag, e.g. -p bag:=flight.mcap')
        self._stopped = threading.Event()
        self._thread: threading.Thread | None = None
        with BagReader(self._bag) as reader:
            self._topics = reader.topics

    def open(self) -> None:
        """Publishers for all topics of the bag whose types are installed."""
        self._ticks = TopicPublisher(self, CLOCK)
        self._publishers_of: dict[str, Any] = {}
        self._images = tuple(topic.name for topic in self._topics if topic.msgtype in IMAGE_TYPES)
        for topic in self._topics:
            quality = image_qos() if topic.msgtype in IMAGE_TYPES else record_qos()
            try:
                self._publishers_of[topic.name] = self.create_lifecycle_publisher(
                    message_class(topic.msgtype), topic.name.lstrip('/'), quality,
                    qos_overriding_options=overridable())
            except MessageError as error:
                self.bad_input(error)

    def begin(self) -> None:
        """Play in a thread."""
        self._stopped.clear()
        self._thread = threading.Thread(target=self._play, name='player', daemon=True)
        self._thread.start()

    def end(self) -> None:
        """Stop playing."""
        self._stopped.set()
        if self._thread:
            self._thread.join(5.0)
            self._thread = None

    def _play(self) -> None:
        try:
            self._await_subscribers()
            self._play_once()
            while self._loop and not self._stopped.is_set():
                self._play_once()
            self._stopped.wait(LINGER_S)
        except SourceError as error:
            self.get_logger().error(str(error))
            self.exit_code = 2
        if not self._stopped.is_set():
            self.finished.set_result(None)

    def _await_subscribers(self) -> None:
        def there() -> bool:
            return all(self._publishers_of[name].get_subscription_count() >= self._wait_for for name in self._images)
        while not there() and not self._stopped.wait(POLL_S):
            pass
        if self._wait_for:
            self._stopped.wait(SETTLE_S)

    def _play_once(self) -> None:
        with BagReader(self._bag) as reader:
            start_ns, first_ns = time.monotonic_ns(), None
            for message in reader.messages():
                first_ns = message.log_stamp_ns if first_ns is None else first_ns
                due_ns = start_ns + (message.log_stamp_ns - first_ns) / self._rate
                if self._stopped.wait(max(0.0, (due_ns - time.monotonic_ns()) / 1e9)):
                    return
                self._publish(message)

    def _publish(self, message: RawMessage) -> None:
        publisher = self._publishers_of.get(message.topic)
        if publisher is None:
            return
        if message.topic in self._images:
            self.stats.count_received(time.monotonic_ns())
            self._ticks.publish(self._stamp_of(message))
        start = time.perf_counter()
        publisher.publish(message.data)
        self.stats.count_processed(time.monotonic_ns(), 1e3 * (time.perf_counter() - start), 0.0)

    def _stamp_of(self, message: RawMessage) -> int:
        try:
            return header_stamp_ns(message.data)
        except MessageError as error:
            self.bad_input(error)
            return message.log_stamp_ns


main = main_of(BagPlayerNode)

if __name__ == '__main__':
    main()
