"""Images that the stages leave out: what is counted, node by node, and what is answered all the same."""

from __future__ import annotations

from typing import Any

import pytest
from diagnostic_msgs.msg import DiagnosticArray
from peers import Peer, found_each_other, image_message, lossless, picture, ready, small
from sensor_msgs.msg import Image, PointCloud2
from std_msgs.msg import Header

from motion_detect_ros.bridge.images import header_of, image_to_msg, stamp_ns

STAGES = ('ego_motion', 'optical_flow', 'art2_clustering')


def header_of_image(number: int) -> Header:
    """10 Hz, from 0.1 s on."""
    return header_of((number + 1) * 100_000_000, 'front')


class Graph:
    """The three stages as processes, and what this peer receives of them."""

    def __init__(self, peer: Peer, start: Any, *settings: str) -> None:
        self._peer = peer
        for stage in STAGES:
            start(stage, *small(*settings), *lossless('image_raw', 'ego_motion', 'flow', 'detections'))
        self.diagnostics = peer.subscribe(DiagnosticArray, '/diagnostics', 1000)
        self.answers = peer.subscribe(PointCloud2, 'detections', 1000)
        self.publisher = peer.advertise(Image, 'image_raw')
        assert ready(peer, 'image_raw', len(STAGES))

    def publish(self, index: int, number: int) -> None:
        """Picture ``index`` as image ``number``."""
        self.publisher.publish(image_to_msg(picture(index), header_of_image(number)))

    @property
    def reports(self) -> int:
        """How many have come of the first stage."""
        return sum(status.name == f'/{STAGES[0]}' for report in self.diagnostics for status in report.status)

    def counted(self, stage: str, name: str) -> int:
        """A counter in the latest report of a stage; -1 before the first."""
        values = [{pair.key: pair.value for pair in status.values}
                  for report in self.diagnostics for status in report.status if status.name == f'/{stage}']
        return int(values[-1][name]) if values else -1

    def await_count(self, stage: str, name: str, wanted: int) -> None:
        assert self._peer.until(lambda: self.counted(stage, name) == wanted), (stage, name, self.counted(stage, name))


@pytest.fixture
def graph(peer: Peer, start: Any, request: pytest.FixtureRequest) -> Graph:
    return Graph(peer, start, *request.param)


@pytest.mark.parametrize('graph', [('queue_size:=1',)], indirect=True, ids=['short mailbox'])
def test_the_first_stage_drops_what_is_too_much_and_images_are_answered_after_it(graph: Graph, peer: Peer):
    images, sent = [image_message(index) for index in range(40)], []

    def publish() -> None:
        image = images[len(sent) % len(images)]
        image.header = header_of((len(sent) + 1) * 100_000_000, 'front')
        graph.publisher.publish(image)
        sent.append(stamp_ns(image.header))

    def dropped() -> bool:
        for _ in range(20):
            publish()
        reports = graph.reports
        return peer.until(lambda: graph.reports > reports) and graph.counted('ego_motion', 'dropped') > 0

    def answered() -> bool:
        """The latest image, unless what is left of the burst crowds it out of the joins."""
        publish()
        return peer.until(lambda: graph.answers and stamp_ns(graph.answers[-1].header) == sent[-1], 3.0)

    assert peer.until(dropped)
    assert peer.until(answered)
    stamps = [stamp_ns(message.header) for message in graph.answers]
    assert set(stamps) <= set(sent)
    assert stamps == sorted(set(stamps))
    for stage in STAGES:
        graph.await_count(stage, 'received', len(sent))
    graph.await_count('art2_clustering', 'processed', len(stamps))
    assert peer.until(lambda: graph.counted('ego_motion', 'processed') + graph.counted('ego_motion', 'dropped')
                      == len(sent))
    first, third = (graph.counted(stage, 'processed') for stage in (STAGES[0], STAGES[2]))
    assert len(sent) > first >= third > 0
    assert peer.until(lambda: first >= graph.counted('optical_flow', 'processed') >= third), 'a report made at its last'


@pytest.mark.parametrize('graph', [('load.decimation_keep:=2', 'load.decimation_of:=5')], indirect=True, ids=['2 of 5'])
def test_m_of_n_images_are_answered_and_none_counts_as_dropped(graph: Graph, peer: Peer):
    first = found_each_other(
        peer, STAGES, graph.diagnostics, graph.answers, lambda number: graph.publish(number % 40, number), cycle=5)
    dropped = {stage: graph.counted(stage, 'dropped') for stage in STAGES}
    processed = {stage: graph.counted(stage, 'processed') for stage in STAGES}
    graph.answers.clear()
    kept = [index for index in range(40) if index % 5 in {0, 1}]
    for index in range(40):
        graph.publish(index, first + index)
        if index in kept:
            wanted = kept.index(index) + 1
            assert peer.until(lambda wanted=wanted: len(graph.answers) == wanted), f'no answer to image {index}'
    assert [message.header for message in graph.answers] == [header_of_image(first + index) for index in kept]
    for stage in STAGES:
        graph.await_count(stage, 'received', first + 40)
        graph.await_count(stage, 'processed', processed[stage] + len(kept))
        assert graph.counted(stage, 'dropped') == dropped[stage]
