"""``bag_player``: plays an MCAP or db3 bag with its original stamps, and /clock with the times of recording."""

from __future__ import annotations

import time
from collections.abc import Iterator
from contextlib import contextmanager

from motion_detect_ros.bridge.bag_publishers import BagPublishers
from motion_detect_ros.bridge.diagnostics import Condition
from motion_detect_ros.bridge.params import declare_simple
from motion_detect_ros.bridge.recorded_results import played_topics
from motion_detect_ros.bridge.runner import main_of
from motion_detect_ros.bridge.serialized import is_static
from motion_detect_ros.bridge.source_node import SourceNode
from motion_detect_ros.bridge.topics import CLOCK, TopicPublisher
from motion_detect_ros.core.errors import MessageError, SourceError
from motion_detect_ros.core.types import NANOSECONDS
from motion_detect_ros.sources.bags import BagReader, RawMessage
from motion_detect_ros.sources.pace import Pace
from motion_detect_ros.sources.timeline import Timed, timeline

#: The age of a recorded stamp says nothing about the player.
UNKNOWN_AGE_MS = float('nan')
#: Messages this late are no longer played at the recorded pace; between two rounds of a loop: seconds.
LATE_S, LOOP_PAUSE_S = 0.1, 0.01


class BagPlayerNode(SourceNode):
    """Publishes the messages of a bag as they were recorded, at ``rate`` times the recorded speed."""

    def __init__(self) -> None:
        super().__init__('bag_player')
        self._bag = str(declare_simple(self, 'bag', '', 'MCAP or db3 file, or a folder that holds one'))
        self._pace = Pace(float(declare_simple(
            self, 'rate', 1.0, 'speed against the recording', 0.001, 1000.0, live=True)))
        self._next_s: float | None = float(declare_simple(
            self, 'position_s', 0.0, 'where to start, and to jump to when it is set, seconds of the recording',
            0.0, 1e6, live=True))
        self._loop = bool(declare_simple(self, 'loop', False, 'start again at the end'))
        wanted = str(declare_simple(self, 'topics', '', 'topics to play, separated by commas; empty = all'))
        results = bool(declare_simple(self, 'play_results', True, 'results of this package that topics does not name'))
        self._with_clock = bool(declare_simple(self, 'clock', True, 'publish /clock; false where another player does'))
        if not self._bag:
            raise SourceError('bag_player: expected the parameter bag, e.g. -p bag:=flight.mcap')
        self._late_s = 0.0
        self.live.add(['rate'], lambda new: self._pace.steer(rate=float(new['rate'])))
        self.live.add(['position_s'], lambda new: self._jump(float(new['position_s'])))
        self.serve('~/pause', lambda: self._hold(True))
        self.serve('~/resume', lambda: self._hold(False))
        with BagReader(self._bag) as reader:
            self._topics, left_out = played_topics(self._bag, reader.topics, wanted, results)
            self._damaged = reader.damaged or ''
        if left_out:
            self.get_logger().info(f'{self._bag}: left out, recorded results of this package: {left_out}')

    def open(self) -> None:
        """Publishers for all topics of the bag that can be played."""
        self._ticks = TopicPublisher(self, CLOCK) if self._with_clock else None
        self._recorded = BagPublishers(self, self._topics)

    def produce(self) -> None:
        """Play, again and again where ``loop`` says so."""
        if self._recorded.images:
            self.await_subscribers(self._recorded.images, lambda: self._ticks.subscribers if self._ticks else 1)
        if not self._recorded.topics:
            raise SourceError(f'{self._bag}: expected a topic that can be played, got none')
        if self._next_s is None:  # it has played before
            self._next_s = float(self.get_parameter('position_s').value)
        while not self.stopped.is_set():
            self._play_on()
            if self._next_s is None and (not self._loop or self.stopped.wait(LOOP_PAUSE_S)):
                return

    def end(self) -> None:
        """Wake the thread wherever it waits, and stop it."""
        self.stopped.set()
        self._pace.interrupt()
        super().end()

    def condition(self) -> Condition:
        """Silence is part of a recording; damage and lateness are not."""
        late = f'{self._late_s:.1f} s behind the recording' if self._late_s > LATE_S else ''
        concern, paused = ', '.join(filter(None, (self._damaged, late))), self._pace.paused
        doing = '' if concern and not paused else f'{"paused" if paused else "playing"} {self._bag}'
        return Condition(concern=concern, idle=super().condition().idle or doing)

    def _jump(self, position_s: float) -> None:
        self._next_s = position_s
        self._pace.interrupt()

    def _hold(self, paused: bool) -> str:
        self._pace.steer(paused=paused)
        return 'paused' if paused else 'playing'

    def _play_on(self) -> None:
        """From ``_next_s`` to the end, unless the user stops it or jumps; earlier static transforms too."""
        start_s, end_ns, self._next_s = self._next_s or 0.0, 0, None
        start_ns = round(start_s * NANOSECONDS)
        with BagReader(self._bag) as reader, self._watched(reader):
            played = filter(self._recorded.takes, reader.messages(self._recorded.topics))
            for number, timed in enumerate(timeline(played)):
                if not number:
                    self._pace.begin(start_ns)
                if self.stopped.is_set() or self._next_s is not None:
                    return
                end_ns = timed.position_ns
                if timed.position_ns >= start_ns:
                    if (late_s := self._pace.wait(timed.position_ns)) is None:
                        return
                    self._late_s = late_s
                    self._tick(timed)
                elif not is_static(timed.message.topic):
                    continue
                self._publish(timed.message)
        if end_ns < start_ns:
            self.get_logger().warning(f'position_s: {start_s:g} is after the end of {self._bag}')

    @contextmanager
    def _watched(self, reader: BagReader) -> Iterator[None]:
        """What is damaged inside a bag shows only once it is read."""
        try:
            yield
        finally:
            if reader.damaged and reader.damaged != self._damaged:
                self._damaged = reader.damaged
                self.get_logger().warning(f'{self._bag}: {self._damaged}')

    def _tick(self, timed: Timed) -> None:
        if timed.jump_ns:
            self.get_logger().warning(f'{timed.jump}: not waited for, nor are further ones', once=True)
        if self._ticks:
            self._ticks.publish(timed.clock_ns)

    def _publish(self, message: RawMessage) -> None:
        self.stats.count_received(time.monotonic_ns())
        start = time.perf_counter()
        try:
            self._recorded.publish(message)
        except MessageError as error:
            self.stats.count_error(str(error))
            self.get_logger().warning(f'{error}; further ones are counted', once=True)
            return
        self.stats.count_processed(time.monotonic_ns(), 1e3 * (time.perf_counter() - start), UNKNOWN_AGE_MS)


main = main_of(BagPlayerNode)

if __name__ == '__main__':
    main()
