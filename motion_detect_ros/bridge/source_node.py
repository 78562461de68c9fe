"""Base of the nodes that make messages by themselves: a thread, and a process that ends when there is no more."""

from __future__ import annotations

import contextlib
import threading
import time
from collections.abc import Callable, Sequence
from concurrent.futures import Future
from typing import Any, TypeVar

from rclpy.duration import Duration

from motion_detect_ros.bridge.diagnostics import Condition
from motion_detect_ros.bridge.managed_node import WARNING_PERIOD_S, ManagedNode
from motion_detect_ros.bridge.params import declare_simple
from motion_detect_ros.core.errors import MotionDetectError, SourceError

#: How long subscribers get to acknowledge the last messages, and these to leave, before the process ends, seconds.
ACKNOWLEDGE_S = 60.0
LINGER_S = 0.5
#: How long a stopped thread gets, seconds.
STOP_TIMEOUT_S = 5.0
#: The same at the end of the process, which takes the thread along.
LAST_STOP_TIMEOUT_S = 1.0
#: How often subscribers are counted, how long others get to be found after them, seconds.
POLL_S = 0.02
SETTLE_S = 0.5
FOLLOW_S = 2.0
BROKEN, UNREADABLE = 1, 2


Result = TypeVar('Result')


class SourceNode(ManagedNode):
    """Runs ``produce`` in a thread while active; ``stopped`` tells it to come back."""

    def __init__(self, name: str) -> None:
        super().__init__(name)
        self.stopped = threading.Event()
        self._thread: threading.Thread | None = None
        self._stop_timeout_s = STOP_TIMEOUT_S
        self._waiting = ''
        self._wait_for = int(declare_simple(
            self, 'wait_for_subscribers', 0, 'subscribers that an image topic must have before the start', 0, 100))
        names = str(declare_simple(
            self, 'wait_for_nodes', '', 'nodes that must subscribe to images before the start, separated by commas'))
        namespace = self.get_namespace().rstrip('/')
        self._wait_for_nodes = [name if name.startswith('/') else f'{namespace}/{name}'
                                for name in (each.strip() for each in names.split(',')) if name]

    def prepare(self) -> None:
        """Open what ``produce`` reads. Raises: SourceError, and the node does not become active."""

    def produce(self) -> None:
        """Publish until there is no more, or ``stopped`` is set. Overridden. Raises: SourceError."""
        raise NotImplementedError

    def await_subscribers(self, images: Sequence[Any], followers: Callable[[], int] = lambda: 1) -> None:
        """Returns once the user's subscribers are there, or when ``stopped``.

        images: publishers of images, each of them will do; followers: number of subscribers of what goes along with
        the images, at least one of which gets FOLLOW_S to be found.
        """
        if not self._wait_for and not self._wait_for_nodes:
            return
        while (missing := self._missing(images)) and not self.stopped.wait(POLL_S):
            self._waiting = f'waiting for {missing}'
            self.get_logger().info(self._waiting, throttle_duration_sec=WARNING_PERIOD_S, skip_first=True)
        self.stopped.wait(SETTLE_S)
        deadline = time.monotonic() + FOLLOW_S
        while not followers() and time.monotonic() < deadline and not self.stopped.wait(POLL_S):
            pass
        self._waiting = ''

    def _missing(self, images: Sequence[Any]) -> str:
        """Which subscribers are not there yet, in a few words."""
        topics = [publisher.topic_name for publisher in images]
        found = max((publisher.get_subscription_count() for publisher in images), default=0)
        wanted = max(self._wait_for, len(self._wait_for_nodes))
        if found < wanted and not self._wait_for_nodes:
            return f'{wanted} subscribers of {" or ".join(topics)}, {found} so far'
        there = {f'{info.node_namespace.rstrip("/")}/{info.node_name}'
                 for topic in topics for info in self.get_subscriptions_info_by_topic(topic)}
        absent = [name for name in self._wait_for_nodes if name not in there]
        if absent or found < wanted:
            return f'{", ".join(absent or self._wait_for_nodes)} to subscribe to {" or ".join(topics)}'
        return ''

    def condition(self) -> Condition:
        """Idle while it waits for subscribers."""
        return Condition(idle=self._waiting)

    def begin(self) -> None:
        """Start the thread. Raises: SourceError where it cannot."""
        if self._thread:
            if self._thread.is_alive():
                raise SourceError(f'{self.get_name()}: the thread of the last activation is still blocked')
            self._thread = None
        self.prepare()
        self.stopped.clear()
        self._thread = threading.Thread(target=self._run, name=self.get_name(), daemon=True)
        self._thread.start()

    def end(self) -> None:
        """Stop the thread; it may start again."""
        self.stopped.set()
        if self._thread:
            self._thread.join(self._stop_timeout_s)
            if self._thread.is_alive() and self.context.ok():
                self.get_logger().warning(f'thread still blocked after {self._stop_timeout_s:.0f} s')

    def close(self) -> None:
        """End whatever runs; a thread that is blocked is left to the end of the process."""
        self._stop_timeout_s = LAST_STOP_TIMEOUT_S
        super().close()

    def unless_stopped(self, action: Callable[[], Result]) -> Result:
        """What ``action`` returns or raises; SIGINT and SIGTERM do not wait for it. Raises: SourceError after one."""
        answer: Future[Result] = Future()
        threading.Thread(target=_answer, args=(answer, action), name='open', daemon=True).start()
        while self.context.ok():
            with contextlib.suppress(TimeoutError):
                return answer.result(POLL_S)
        raise SourceError(f'{self.get_name()}: told to stop')

    def _await_acknowledgements(self) -> None:
        """A process that ends takes along what a reliable subscriber has not received yet."""
        deadline, poll = time.monotonic() + ACKNOWLEDGE_S, Duration(seconds=POLL_S)
        for publisher in self._publishers_made:
            while not publisher.wait_for_all_acked(poll) and time.monotonic() < deadline and not self.stopped.is_set():
                pass

    def _run(self) -> None:
        try:
            self.produce()
            self._await_acknowledgements()
            self.stopped.wait(LINGER_S)
        except Exception as error:  # a dead thread would leave a process that does nothing
            if self.context.ok():
                self.fail(error)
                self.exit_code = UNREADABLE if isinstance(error, MotionDetectError) else BROKEN
                self.report()
                self.stopped.wait(LINGER_S)
        if not self.stopped.is_set():
            self.finished.set_result(None)


def _answer(answer: Future[Result], action: Callable[[], Result]) -> None:
    try:
        answer.set_result(action())
    except Exception as error:
        answer.set_exception(error)
