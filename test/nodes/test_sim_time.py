"""Nodes on simulated time: no clock, a clock, and a clock that jumps back."""

from __future__ import annotations

from diagnostic_msgs.msg import DiagnosticArray
from peers import all_came, image_message, lossless, ready, small
from rosgraph_msgs.msg import Clock
from sensor_msgs.msg import Image, PointCloud2

from motion_detect_ros.bridge.images import stamp_ns
from motion_detect_ros.bridge.records import ego_from_msg, read_detections
from motion_detect_ros.core.types import EgoStatus

SIM = ('-p', 'use_sim_time:=true')
FRAMES = 12


def test_without_a_clock_there_are_diagnostics_and_subscriptions_on_demand(peer, start):
    """Time stands at 0 until a clock comes; the health of a node must not wait for it."""
    start('overlay', *SIM)
    reports = peer.subscribe(DiagnosticArray, '/diagnostics')
    assert peer.until(lambda: len(reports) >= 2)
    assert [stamp_ns(message.header) for message in reports] == [0] * len(reports)
    peer.subscribe(Image, '/overlay/overlay')
    assert peer.until(lambda: peer.node.count_subscribers('image_raw') == 1)


def test_a_clock_that_jumps_back_costs_the_history_only(peer, start):
    start('pipeline', *small('use_sim_time:=true'), *lossless('ego_motion', 'detections'))
    reports, egos = peer.subscribe(DiagnosticArray, '/diagnostics'), peer.subscribe(PointCloud2, 'ego_motion')
    answers = peer.subscribe(PointCloud2, 'detections')
    publisher, clock = peer.advertise(Image, 'image_raw'), peer.advertise(Clock, '/clock')
    assert ready(peer, 'image_raw')
    assert ready(peer, '/clock')

    def play() -> list[set[int]]:
        """Ids in each answer to the images, whose stamps the clock shows before they come."""
        answers.clear()
        for index in range(FRAMES):
            image = image_message(index)
            clock.publish(Clock(clock=image.header.stamp))
            publisher.publish(image)
            assert peer.until(lambda index=index: len(answers) > index), f'no answer to image {index}'
        return [set(read_detections(message)['id'].tolist()) for message in answers]

    before = play()
    last_stamp = stamp_ns(image_message(FRAMES - 1).header)
    assert peer.until(lambda: reports and stamp_ns(reports[-1].header) == last_stamp)
    seen = len(reports)
    after = play()
    all_came(peer, egos, [stamp_ns(image_message(index).header) for index in range(FRAMES)] * 2)
    assert [ego_from_msg(egos[index]).status for index in (0, 1, FRAMES, FRAMES + 1)] == [
        EgoStatus.FIRST_FRAME, EgoStatus.OK, EgoStatus.TIME_JUMP, EgoStatus.OK]
    assert before[-1] and after[-1]
    assert not set().union(*before) & set().union(*after)
    assert [bool(ids) for ids in after] == [bool(ids) for ids in before]
    assert peer.until(lambda: len(reports) >= seen + 2)
