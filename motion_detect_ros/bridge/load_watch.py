"""Work that follows the load (``load.adapt``): the node that gets the images first decides the step, others follow."""

from __future__ import annotations

import time
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import replace
from typing import Any

from motion_detect_ros.bridge.diagnostics import Condition
from motion_detect_ros.bridge.load import LOAD, Stage, StageTime
from motion_detect_ros.bridge.qos import overridable
from motion_detect_ros.bridge.stage_node import StageNode
from motion_detect_ros.bridge.topics import TopicPublisher
from motion_detect_ros.core.errors import MessageError
from motion_detect_ros.core.load_control import STEPS, LoadControl

#: How often the load is held against the rate of the images, seconds.
LOOK_PERIOD_S = 1.0
#: A stage from which nothing has come for so long is not waited for, seconds.
GONE_S = 5.0


class SteppedNode(StageNode):
    """A stage node that works at a step, says which in diagnostics, and has a ``LoadWatch`` or a ``StageLoad``."""

    load_step = 0
    _warned: frozenset[str] = frozenset()

    def warn_of(self, complaints: tuple[str, ...]) -> None:
        """Say each once."""
        for words in complaints:
            if words not in self._warned:
                self._warned |= {words}
                self.get_logger().warning(words)

    def limit_width(self, share: float) -> None:
        """From the next image on work at this share, 0 .. 1, of the width at most. Overridden."""
        raise NotImplementedError

    def work_at(self, number: int) -> None:
        """The step from the next image on; called between two images."""
        self.load_step, step = number, STEPS[number]
        self.limit_width(step.width_share)
        self.decimate(step.of)

    def condition(self) -> Condition:
        """As for all stages; and what is left out for want of time."""
        found = super().condition()
        return replace(found, concern=', '.join(filter(None, (found.concern, STEPS[self.load_step].reduced))))

    def extra_diagnostics(self) -> tuple[tuple[str, str], ...]:
        """As for all stages; and what the step costs."""
        return *super().extra_diagnostics(), ('load_cost', f'{STEPS[self.load_step].cost:g}')


class LoadWatch:
    """Decides the step, by the time of the slowest stage: separate nodes work on different images at once."""

    def __init__(self, node: SteppedNode) -> None:
        self._node = node
        self._control = LoadControl()
        self._told, self._heard_s = set[Stage](), dict[Stage, float]()
        self._received = 0
        self._start_window(time.monotonic(), 0)
        node.every(LOOK_PERIOD_S, lambda: self.look(time.monotonic(), self._received_by_node()))

    def subscribe(self) -> None:
        """To the times of the stages behind the node, until it is deactivated."""
        self._told.clear()
        self._heard_s.clear()
        self._node.subscribe(LOAD.kind, LOAD.name, self._on_load, LOAD.qos(), qos_overriding_options=overridable())

    def add(self, compute_ms: float) -> None:
        """What the node itself took for an image."""
        self._times.append((None, self._node.load_step, compute_ms))

    def use_config(self, restart: bool) -> None:
        """The settings of the node have changed, or it starts anew; called between two images."""
        if restart or not self._node.config.load.adapt:
            self._control = LoadControl()
            self._start_window(time.monotonic(), self._received_by_node())  # what there was to do before tells nothing
        self._node.work_at(self._control.number)

    def look(self, now_s: float, received: int) -> None:
        """More or less work where images take longer than their period, or have time to spare.

        now_s: of ``time.monotonic``; received: images since the start of the node.
        """
        paused, self._received = received == self._received, received
        self._heard_s.update(dict.fromkeys(self._told, now_s))
        self._told.clear()
        works = self._node.active and self._node.config.load.adapt
        compute_ms, images = self._slowest_ms(now_s), received - self._since_received
        if works and compute_ms is not None and images:
            self._decide(compute_ms, (now_s - self._since_s) / images)
        elif works and not paused:
            return  # a stage has yet to tell
        self._start_window(now_s, received)

    def _decide(self, compute_ms: float, period_s: float) -> None:
        load = self._node.config.load
        if self._control.decide(1e-3 * compute_ms, period_s * load.decimation_of / load.decimation_keep):
            self._node.locked(lambda: self._node.work_at(self._control.number))
            self._node.get_logger().warning(self._control.step.reduced or 'load: full work again')

    def _slowest_ms(self, now_s: float) -> float | None:
        """Mean time for an image at the present step of the stage that takes longest; None while one has yet to tell.

        What still comes of images before a change is of another step.
        """
        waited_for = [None, *(stage for stage, heard_s in self._heard_s.items() if now_s - heard_s < GONE_S)]
        times = [[ms for stage, number, ms in self._times if (stage, number) == (each, self._node.load_step)]
                 for each in waited_for]
        return max(sum(each) / len(each) for each in times) if all(times) else None

    def _start_window(self, now_s: float, received: int) -> None:
        self._times: list[tuple[Stage | None, int, float]] = []
        self._since_s, self._since_received = now_s, received

    def _received_by_node(self) -> int:
        return self._node.stats.summary(time.monotonic_ns()).received

    def _on_load(self, msg: Any) -> None:
        try:
            told = LOAD.from_msg(msg)
        except MessageError as error:
            self._node.bad_input(MessageError(f'{self._node.resolve_topic_name(LOAD.name)}: {error}'))
            return
        self._told.add(told.stage)
        self._times.append((told.stage, told.load_step, told.compute_ms))


class StageLoad:
    """Follows the step that comes with each image, and tells what the stage took for it."""

    def __init__(self, node: SteppedNode, stage: Stage) -> None:
        self._node, self._stage = node, stage

    def advertise(self) -> None:
        """The node is configured: a publisher, and full work until an image says otherwise."""
        self._publisher = TopicPublisher(self._node, LOAD)
        self._node.work_at(0)

    @contextmanager
    def image(self, header: Any, number: int) -> Iterator[None]:
        """The work on one image happens in here, at the step of that number; one that fails tells no time."""
        start = time.perf_counter()
        self._node.work_at(number)
        yield
        if self._node.config.load.adapt:
            self._publisher.publish(StageTime(self._stage, 1e3 * (time.perf_counter() - start), number), header)
