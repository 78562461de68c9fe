"""Images whose stamps are repeated, out of order, missing, before 1970 or beyond 2038, through real nodes."""

from __future__ import annotations

import itertools
from collections import Counter

import pytest
from builtin_interfaces.msg import Time
from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus
from peers import COUNTED, PATIENT, found_each_other, picture, ready, small
from sensor_msgs.msg import Image, PointCloud2

from motion_detect_ros.bridge.images import header_of, image_to_msg, stamp_ns
from motion_detect_ros.bridge.records import ego_from_msg, read_detections
from motion_detect_ros.core.types import EgoStatus

pytestmark = pytest.mark.messages

PERIOD_NS = 100_000_000
FRAMES = 30
GRAPHS = {'pipeline': ('pipeline',), 'nodes': ('ego_motion', 'optical_flow', 'art2_clustering')}
#: Order in which the images of one flight arrive, by their place in it.
ARRIVALS = {
    'every image twice': [index for index in range(FRAMES) for _ in range(2)],
    'one swap in ten': [index + {8: 1, 9: -1}.get(index % 10, 0) for index in range(FRAMES)],
    'shuffled by three': [first + offset for first in range(0, FRAMES, 3) for offset in (1, 2, 0)],
}
NEW_FLIGHT_NS = 60_000_000_000


def image(index: int, stamp: int) -> Image:
    return image_to_msg(picture(index), header_of(stamp, 'front'))


def early(number: int) -> Image:
    """Before the flights of the test."""
    return image(number % FRAMES, (number + 1) * PERIOD_NS)


def running_maxima(numbers: list[int]) -> list[int]:
    return [number for number, before in zip(numbers, [-1, *itertools.accumulate(numbers, max)], strict=False)
            if number > before]


def values(reports: list[DiagnosticArray], node: str) -> dict[str, str]:
    found = [message.status[0] for message in reports if message.status[0].name == f'/{node}']
    return {pair.key: pair.value for pair in found[-1].values} if found else {}


def counts(reports: list[DiagnosticArray], node: str) -> Counter[str]:
    return Counter({key: int(value) for key, value in values(reports, node).items() if key in COUNTED})


@pytest.mark.parametrize('graph', GRAPHS)
def test_images_seen_already_or_late_are_left_out_and_nothing_else_is_lost(graph, peer, start, shown):
    for node in GRAPHS[graph]:
        start(node, *small(*PATIENT))
    answers, egos = peer.subscribe(PointCloud2, 'detections'), peer.subscribe(PointCloud2, 'ego_motion')
    reports = peer.subscribe(DiagnosticArray, '/diagnostics')
    publisher = peer.advertise(Image, 'image_raw')
    assert ready(peer, 'image_raw', len(GRAPHS[graph]))
    found_each_other(peer, GRAPHS[graph], reports, answers, lambda number: publisher.publish(early(number)))
    before = {node: counts(reports, node) for node in GRAPHS[graph]}
    sent = left_out = 0
    for number, (name, arrivals) in enumerate(ARRIVALS.items(), start=1):
        answers.clear()
        egos.clear()
        stamps = [number * NEW_FLIGHT_NS + index * PERIOD_NS for index in arrivals]
        expected = running_maxima(stamps)
        for index, stamp in zip(arrivals, stamps, strict=True):
            publisher.publish(image(index, stamp))
        assert peer.until(lambda expected=expected: len(answers) >= len(expected) <= len(egos)), name
        assert [stamp_ns(message.header) for message in answers] == expected, name
        statuses = [ego_from_msg(message).status for message in egos]
        assert set(statuses[1:]) == {EgoStatus.OK}, name
        assert any(len(read_detections(message)) for message in answers), name
        sent, left_out = sent + len(stamps), left_out + len(stamps) - len(expected)
    for node in GRAPHS[graph]:
        assert peer.until(
            lambda node=node: (counts(reports, node) - before[node])['processed'] == sent - left_out), node
        found = counts(reports, node) - before[node]
        assert found['stamps_seen'] == FRAMES
        assert found['stamps_seen'] + found['stamps_late'] == left_out == found['dropped'], found
        assert (found['stamps_jump'], found['received']) == (0, sent)
    shown('every image twice, one swap in ten, images shuffled by three',
          'those seen already or late are left out and counted, no other is lost, nothing is reset, stamps increase',
          f'{graph}: {sent - left_out} of {sent} used, {left_out} left out, 0 resets')


def test_a_camera_that_does_not_stamp_is_named_and_its_images_are_left_out(peer, start, shown):
    start('pipeline', *small())
    reports, answers = peer.subscribe(DiagnosticArray, '/diagnostics'), peer.subscribe(PointCloud2, 'detections')
    publisher = peer.advertise(Image, 'image_raw')
    assert ready(peer, 'image_raw')
    levels = (DiagnosticStatus.WARN, DiagnosticStatus.ERROR)

    def named() -> bool:
        publisher.publish(image(0, 0))
        found = [message.status[0] for message in reports]
        return ({status.level for status in found if 'carry no stamp' in status.message} >= set(levels[:1])
                and any(status.level == levels[1] and 'stamps missing' in status.message for status in found))

    assert peer.until(named)
    assert len(answers) == 1
    shown('a camera that never stamps', 'named, WARN then ERROR; or its time of arrival is used, if told so',
          'left out, named, ERROR')


def test_images_without_stamps_are_used_with_their_time_of_arrival_where_that_is_asked_for(peer, start, shown):
    start('pipeline', *small('stamp_missing:=arrival'))
    reports, answers = peer.subscribe(DiagnosticArray, '/diagnostics'), peer.subscribe(PointCloud2, 'detections')
    publisher = peer.advertise(Image, 'image_raw')
    assert ready(peer, 'image_raw')
    begin = peer.node.get_clock().now().nanoseconds
    for index in range(FRAMES):
        publisher.publish(image(index, 0))
        assert peer.until(lambda index=index: len(answers) > index)
        peer.rest(0.05)  # a camera's pace, as the time of arrival is the time of the picture
    stamps = [stamp_ns(message.header) for message in answers]
    assert stamps == sorted(set(stamps))
    assert begin <= stamps[0] < stamps[-1] <= peer.node.get_clock().now().nanoseconds
    assert any(len(read_detections(message)) for message in answers)
    assert peer.until(lambda: any(
        message.status[0].level == DiagnosticStatus.WARN and 'time of arrival is used' in message.status[0].message
        for message in reports))
    shown('a camera that never stamps', 'named, WARN then ERROR; or its time of arrival is used, if told so',
          f'with stamp_missing: arrival {len(answers)} of {FRAMES} answered')


#: What a header has room for and ROS times do not.
NEGATIVE, BEYOND = Time(sec=-1, nanosec=0), Time(sec=2**31 - 1, nanosec=2**32 - 1)


@pytest.mark.parametrize('graph', GRAPHS)
def test_a_negative_stamp_or_one_beyond_2038_costs_its_image_only_in_every_node(graph, peer, start, shown):
    for node in GRAPHS[graph]:
        start(node, *small(*PATIENT))
    answers, egos = peer.subscribe(PointCloud2, 'detections'), peer.subscribe(PointCloud2, 'ego_motion')
    reports = peer.subscribe(DiagnosticArray, '/diagnostics')
    publisher = peer.advertise(Image, 'image_raw')
    assert ready(peer, 'image_raw', len(GRAPHS[graph]))
    found_each_other(peer, GRAPHS[graph], reports, answers, lambda number: publisher.publish(early(number)))
    answers.clear()
    egos.clear()
    stamps = [NEW_FLIGHT_NS + index * PERIOD_NS for index in range(8)]
    for index, stamp in enumerate(stamps):
        message = image(index, stamp)
        message.header.stamp = {4: NEGATIVE, 6: BEYOND}.get(index, message.header.stamp)
        publisher.publish(message)
    assert peer.until(lambda: len(answers) >= 6 <= len(egos))
    assert [stamp_ns(message.header) for message in answers] == [*stamps[:4], stamps[5], stamps[7]]
    assert [ego_from_msg(message).status for message in egos][1:] == [EgoStatus.OK] * 5
    shown('a negative stamp, and one beyond 2038', 'cost their images only, in every node',
          f'{graph}: 6 of 8 answered')


@pytest.mark.parametrize('node', ['pipeline', 'ego_motion'])
def test_a_jump_back_that_an_image_left_out_tells_is_one_for_the_next(node, peer, start):
    """Of every four images one is used. Before the seventh the clock goes back by 0.3 s: the ninth comes 0.4 s after
    the fifth and has a stamp of 0.1 s after it.
    """
    start(node, *small('load.decimation_of:=4', 'reorder_s:=0.1'))
    egos = peer.subscribe(PointCloud2, 'ego_motion')
    publisher = peer.advertise(Image, 'image_raw')
    assert ready(peer, 'image_raw')
    for index in range(13):
        publisher.publish(image(index, (index + 1 - (3 if index >= 6 else 0)) * PERIOD_NS))
        assert index % 4 or peer.until(lambda count=index // 4 + 1: len(egos) == count)
    assert [ego_from_msg(message).status for message in egos] == [
        EgoStatus.FIRST_FRAME, EgoStatus.OK, EgoStatus.TIME_JUMP, EgoStatus.OK]
