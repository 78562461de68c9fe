"""``bag_player``: plays an MCAP or db3 bag with its original stamps, and /clock with the times of recording."""

from __future__ import annotations

import time
from typing import Any

from motion_detect_ros.bridge.diagnostics import Condition
from motion_detect_ros.bridge.params import declare_simple
from motion_detect_ros.bridge.qos import image_qos, imu_qos, latched_qos, record_qos
from motion_detect_ros.bridge.runner import main_of
from motion_detect_ros.bridge.serialized import IMAGE_TYPES, IMU_TYPE, message_class, with_clock
from motion_detect_ros.bridge.source_node import SourceNode
from motion_detect_ros.bridge.topics import CLOCK, TopicPublisher
from motion_detect_ros.core.errors import MessageError, SourceError
from motion_detect_ros.core.types import NANOSECONDS
from motion_detect_ros.sources.bags import BagReader, RawMessage, TopicInfo

#: The age of a recorded stamp says nothing about the player.
UNKNOWN_AGE_MS = float('nan')
#: Messages this late are no longer played at the recorded pace, seconds.
LATE_S = 0.1
#: Between two rounds of a loop, seconds.
LOOP_PAUSE_S = 0.01
#: Published once and kept for late subscribers.
STATIC_TRANSFORMS = 'tf_static'


class BagPlayerNode(SourceNode):
    """Publishes the messages of a bag as they were recorded, at ``rate`` times the recorded speed."""

    def __init__(self) -> None:
        super().__init__('bag_player')
        self._bag = str(declare_simple(self, 'bag', '', 'MCAP or db3 file, or a folder that holds one'))
        self._rate = float(declare_simple(self, 'rate', 1.0, 'speed against the recording', 0.001, 1000.0))
        self._loop = bool(declare_simple(self, 'loop', False, 'start again at the end'))
        wanted = str(declare_simple(self, 'topics', '', 'topics to play, separated by commas; empty = all'))
        self._with_clock = bool(declare_simple(self, 'clock', True, 'publish /clock; false where another player does'))
        if not self._bag:
            raise SourceError('bag_player: expected the parameter bag, e.g. -p bag:=flight.mcap')
        self._late_s = 0.0
        with BagReader(self._bag) as reader:
            self._topics = _chosen(self._bag, reader.topics, wanted)
            self._damaged = reader.damaged or ''

    def open(self) -> None:
        """Publishers for all topics of the bag whose types are installed."""
        self._ticks = TopicPublisher(self, CLOCK) if self._with_clock else None
        self._publishers_of: dict[str, Any] = {}
        self._images = tuple(topic.name for topic in self._topics if topic.msgtype in IMAGE_TYPES)
        for topic in self._topics:
            try:
                self._publishers_of[topic.name] = self.advertise(
                    message_class(topic.msgtype), topic.name.lstrip('/'), _quality(topic))
            except MessageError as error:
                self.bad_input(error)

    def produce(self) -> None:
        """Play, again and again where ``loop`` says so."""
        if self._images:
            self.await_subscribers(self._subscribers, lambda: self._ticks.subscribers if self._ticks else 1)
        if not self._publishers_of:
            raise SourceError(f'{self._bag}: expected a topic whose type is installed, got none')
        self._play_once()
        while self._loop and not self.stopped.wait(LOOP_PAUSE_S):
            self._play_once()

    def condition(self) -> Condition:
        """Silence is part of a recording; damage and lateness are not."""
        late = f'{self._late_s:.1f} s behind the recording' if self._late_s > LATE_S else ''
        concern = ', '.join(filter(None, (self._damaged, late)))
        idle = super().condition().idle or ('' if concern else f'playing {self._bag}')
        return Condition(concern=concern, idle=idle)

    def _subscribers(self) -> int:
        """Of the image topic that has most."""
        return max((self._publishers_of[name].get_subscription_count() for name in self._images), default=0)

    def _play_once(self) -> None:
        with BagReader(self._bag) as reader:
            start_ns, first_ns = time.monotonic_ns(), None
            for clock_ns, message in with_clock(reader.messages(list(self._publishers_of))):
                first_ns = clock_ns if first_ns is None else first_ns
                due_ns = start_ns + (clock_ns - first_ns) / self._rate
                if self.stopped.wait(max(0.0, (due_ns - time.monotonic_ns()) / NANOSECONDS)):
                    return
                self._late_s = (time.monotonic_ns() - due_ns) / NANOSECONDS
                self._publish(message, clock_ns)

    def _publish(self, message: RawMessage, clock_ns: int) -> None:
        self.stats.count_received(time.monotonic_ns())
        if self._ticks:
            self._ticks.publish(clock_ns)
        start = time.perf_counter()
        self._publishers_of[message.topic].publish(message.data)
        self.stats.count_processed(time.monotonic_ns(), 1e3 * (time.perf_counter() - start), UNKNOWN_AGE_MS)


def _quality(topic: TopicInfo) -> Any:
    if topic.name.rpartition('/')[2] == STATIC_TRANSFORMS:
        return latched_qos()
    if topic.msgtype == IMU_TYPE:
        return imu_qos()
    return image_qos() if topic.msgtype in IMAGE_TYPES else record_qos()


def _chosen(bag: str, topics: tuple[TopicInfo, ...], wanted: str) -> tuple[TopicInfo, ...]:
    """The topics to play; a recorded /clock is not, as the times of recording are the clock. Raises: SourceError."""
    names = {name.strip().lstrip('/') for name in wanted.split(',')} - {''}
    missing = names - {topic.name.lstrip('/') for topic in topics}
    if missing:
        listed = ', '.join(f'{topic.name} ({topic.count})' for topic in topics) or 'none'
        raise SourceError(f'{bag}: no topic {", ".join(sorted(missing))}; topics (messages): {listed}')
    chosen = tuple(topic for topic in topics if topic.name.lstrip('/') in names) if names else topics
    if not sum(topic.count for topic in chosen):
        raise SourceError(f'{bag}: expected messages to play, found none in {len(chosen)} topics')
    return tuple(topic for topic in chosen if topic.name != CLOCK.name)


main = main_of(BagPlayerNode)

if __name__ == '__main__':
    main()
