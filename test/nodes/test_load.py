"""Work that follows the load (``load.adapt``): the node pipeline, and the stages as processes of their own."""

from __future__ import annotations

import statistics
import time
from collections.abc import Callable
from itertools import pairwise
from typing import Any

import numpy as np
import pytest
from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus
from peers import PATIENT, TIMEOUT_S, Peer, picture, ready, small
from sensor_msgs.msg import Image, PointCloud2

from motion_detect_ros.bridge.images import header_of, image_to_msg, stamp_ns
from motion_detect_ros.bridge.load import Stage, StageTime, load_from_msg
from motion_detect_ros.bridge.records import ego_from_msg, read_detections
from motion_detect_ros.core.load_control import STEPS

pytestmark = pytest.mark.messages

PICTURES = [picture(index) for index in range(46)]


def reported_while_publishing(
    peer: Peer, publisher: Any, reports: list[Any], words: str, period_s: float, level: bytes = DiagnosticStatus.WARN,
    first: int = 1,
) -> int:
    """Publishes pictures until such a report comes; the index of the next one, 0 where it never does."""
    deadline, looked, index = time.monotonic() + 120.0, 0.0, first
    while time.monotonic() < deadline:
        publisher.publish(image_to_msg(PICTURES[index % len(PICTURES)], header_of(100_000_000 * index, 'front')))
        index += 1
        time.sleep(period_s)
        if time.monotonic() > looked + 0.5:
            peer.rest(0.01)
            looked = time.monotonic()
        latest = reports[-1].status[0] if reports else None
        if latest and latest.level == level and words in latest.message:
            return index
    return 0


def test_more_images_than_it_can_do_are_met_with_less_work_and_fewer_again_with_all(peer: Peer, start) -> None:
    """At most 320x240: a hundred and more a second are too many at full work on any machine this runs on."""
    start('pipeline', *small('load.adapt:=true', 'queue_size:=1', 'trajectories.use:=true'))
    publisher = peer.advertise(Image, 'image_raw')
    reports = peer.subscribe(DiagnosticArray, '/diagnostics')
    assert ready(peer, 'image_raw')
    index = reported_while_publishing(peer, publisher, reports, 'load reduced: ', 0.004)
    assert index
    reports.clear()
    assert reported_while_publishing(peer, publisher, reports, 'Hz', 0.5, DiagnosticStatus.OK, index)
    values = {pair.key: pair.value for pair in reports[-1].status[0].values}
    assert values['load_cost'] == '1'


STAGES = ('ego_motion', 'optical_flow', 'art2_clustering')
#: Stamps of the pictures are so far apart, however fast they are published.
STEP_NS = 20_000_000
WIDTH, HEIGHT, GRID_PX = 640, 360, 4
#: The camera follows a vehicle over the ground: so far from picture to picture, pixels, without end.
PAN_PX = 2
#: Of the vehicle over the ground, pixels a second.
SPEED = PAN_PX * 1e9 / STEP_NS
#: How slow images have to come for full work to fit on any machine, seconds.
SLOW_S = 0.3


def followed_vehicle(index: int) -> np.ndarray:
    """(HEIGHT, WIDTH) uint8: ground that goes to the left, round and round, and a block that stays in the middle."""
    ground, block = (
        np.kron(np.random.default_rng(seed).integers(0, 256, shape, np.uint8), np.ones((10, 10), np.uint8))
        for seed, shape in ((1, (HEIGHT // 10, WIDTH // 10)), (2, (12, 16))))
    image = np.roll(ground, -PAN_PX * index, axis=1)
    image[120:240, 240:400] = block
    return image


ROUND = [followed_vehicle(index) for index in range(WIDTH // PAN_PX)]


def by_index(messages: list[Any], convert: Callable[[Any], Any]) -> dict[int, Any]:
    """Which image each belongs to -> what it says."""
    return {stamp_ns(msg.header) // STEP_NS: convert(msg) for msg in messages}


class Graph:
    """The separate stages, and what they say of each image, by its index."""

    def __init__(self, peer: Peer, start: Any, *arguments: str) -> None:
        self._peer, self.index = peer, 0
        for node in STAGES:
            start(node, *(word for each in (f'preprocessing.max_width_px:={WIDTH}', 'load.threads:=1', *arguments)
                          for word in ('-p', each)))
        self._publisher = peer.advertise(Image, 'image_raw')
        self._egos, self._flows = peer.subscribe(PointCloud2, 'ego_motion', 1000), peer.subscribe(Image, 'flow', 1000)
        self._found, self._times = (peer.subscribe(PointCloud2, name, 1000) for name in ('detections', 'load'))
        self._reports = peer.subscribe(DiagnosticArray, '/diagnostics')
        self.await_stages()

    def await_stages(self) -> None:
        """Until they have found this peer; and each other, which answers to slow images show."""
        assert ready(self._peer, 'image_raw', len(STAGES))
        for _ in range(100):
            self.publish(5, 0.1)
            if self.index in self.detections:
                return
        raise AssertionError(self.reported())

    def publish(self, count: int, period_s: float) -> None:
        """The next so many pictures."""
        due = time.monotonic()
        for _ in range(count):
            self.index += 1
            self._publisher.publish(image_to_msg(
                ROUND[self.index % len(ROUND)], header_of(STEP_NS * self.index, 'front')))
            due = max(time.monotonic(), due + period_s)
            self._peer.until(lambda due=due: time.monotonic() >= due, 60.0)

    def publish_until(self, reached: Callable[[], bool], period_s: float) -> bool:
        """Pictures at such a rate until that holds at the end of a second; False where it never does."""
        deadline = time.monotonic() + TIMEOUT_S
        while time.monotonic() < deadline:
            self.publish(max(1, round(1.0 / period_s)), period_s)
            if reached():
                return True
        return False

    def overload(self) -> bool:
        """Several times as many pictures as the slowest stage can do, until all stages leave images out."""
        self.publish(10, SLOW_S)
        full_ms = max(statistics.median(one.compute_ms for one in list(of_stage.values())[-10:])
                      for of_stage in self.told.values())
        return self.publish_until(lambda: all('1 image of' in message for message, _ in self.reported().values()),
                                  0.25e-3 * full_ms)

    def recovered(self) -> bool:
        """Whether all stages work fully again, while few pictures come."""
        return self.publish_until(lambda: all(cost == '1' for _, cost in self.reported().values()), SLOW_S)

    def settled(self) -> bool:
        """Once the last stage has answered the latest image that the first one took."""
        def answered() -> bool:
            latest = max(self.steps, default=0)
            return latest in self.detections and self.index - latest < STEPS[-1].of
        return self._peer.until(answered)

    @property
    def steps(self) -> dict[int, int]:
        """That came with the ego-motion of each image."""
        return by_index(self._egos, lambda msg: ego_from_msg(msg).load_step)

    @property
    def widths(self) -> dict[int, int]:
        """Of the flow, cells."""
        return by_index(self._flows, lambda msg: msg.width)

    @property
    def told(self) -> dict[Stage, dict[int, StageTime]]:
        """What the other stages told of each image."""
        return {stage: by_index([msg for msg in self._times if load_from_msg(msg).stage == stage], load_from_msg)
                for stage in Stage}

    @property
    def detections(self) -> dict[int, Any]:
        """Records of each image."""
        return by_index(self._found, read_detections)

    def reported(self) -> dict[str, tuple[str, str]]:
        """The latest of each stage: message, and cost of the step."""
        return {message.status[0].name.strip('/'): (
            message.status[0].message, {pair.key: pair.value for pair in message.status[0].values}['load_cost'])
            for message in self._reports}


def test_separate_stages_do_less_from_the_same_image_on_and_come_back(peer: Peer, start) -> None:
    graph = Graph(peer, start, 'load.adapt:=true', *PATIENT)
    graph.publish(25, 0.1)  # a track is confirmed
    first = graph.index
    assert graph.overload(), graph.reported()
    assert graph.recovered(), graph.reported()
    graph.publish(5, SLOW_S)
    steps, widths, detections = ({index: value for index, value in each.items() if index >= first}
                                 for each in (graph.steps, graph.widths, graph.detections))
    reached = set(steps.values())
    assert 0 in reached and max(reached) >= 3

    # one step for an image in all stages
    assert len(detections) > 0.9 * len(steps) and len(widths) > 0.9 * len(steps)
    assert {(steps[index], width) for index, width in widths.items()} == {
        (step, round(WIDTH * STEPS[step].width_share) // GRID_PX) for step in reached}
    for stage, of_stage in graph.told.items():
        later = {index: one for index, one in of_stage.items() if index >= first}
        assert all(one.load_step == steps[index] for index, one in later.items()), stage
        assert {one.load_step for one in later.values()} == reached

    # images are left out by the step; not those that waited when it came, so the last ones tell, on the way back
    for step in reached:
        gaps = [after - before for before, after in pairwise(sorted(steps)) if steps[before] == steps[after] == step]
        assert gaps[-2:] == [STEPS[step].of] * 2, step

    # one vehicle, known by one id, as fast as it is
    assert {len(records) for records in detections.values()} == {1}
    assert len({int(records['id'][0]) for records in detections.values()}) == 1
    for index, records in detections.items():
        np.testing.assert_allclose(records['vel_u'][0], SPEED, atol=0.15 * SPEED, err_msg=f'{index}: {steps[index]}')
        np.testing.assert_allclose(records['vel_v'][0], 0.0, atol=0.15 * SPEED, err_msg=f'{index}: {steps[index]}')
