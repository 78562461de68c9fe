"""A node that gets images and can use none of them never says OK."""

from __future__ import annotations

import time
from collections.abc import Callable

import numpy as np
import pytest
from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus
from peers import PATIENT, TIMEOUT_S, image_message, picture, ready, small
from sensor_msgs.msg import Image, PointCloud2

from motion_detect_ros.bridge.images import header_of, image_to_msg, stamp_ns

PERIOD_NS = 100_000_000


def uniform(index: int) -> Image:
    return image_to_msg(np.full((240, 320), 128, np.uint8), header_of((index + 1) * PERIOD_NS, 'front'))


def noise(index: int) -> Image:
    pixels = np.random.default_rng(index).integers(0, 256, (240, 320), np.uint8)
    return image_to_msg(pixels, header_of((index + 1) * PERIOD_NS, 'front'))


def flight(index: int) -> Image:
    return image_to_msg(picture(index % 40), header_of((index + 1) * PERIOD_NS, 'front'))


def frozen(_index: int) -> Image:
    return image_message(0)


def malformed(index: int) -> Image:
    image = flight(index)
    image.step = 10
    return image


def back_and_forth(index: int) -> Image:
    """Every image is two seconds before or after the last."""
    return image_to_msg(picture(index % 2), header_of((1 + 2 * (index % 2)) * 1_000_000_000, 'front'))


IN_VAIN: dict[str, tuple[str, Callable[[int], Image], str]] = {
    'images of one grey': ('pipeline', uniform, 'ego-motion is LOW_TEXTURE'),
    'noise': ('pipeline', noise, 'ego-motion is '),
    'a stamp that stands still': ('pipeline', frozen, 'stamps seen already'),
    'malformed images': ('pipeline', malformed, '/image_raw: '),
    'a clock that jumps to and fro': ('ego_motion', back_and_forth, 'ego-motion is TIME_JUMP'),
    'no ego_motion of these images': ('optical_flow', flight, 'nothing of the same stamp from ego_motion'),
}


@pytest.mark.parametrize('name', IN_VAIN)
def test_images_in_vain_are_a_warning_then_an_error(name, peer, start, shown):
    node, make, reason = IN_VAIN[name]
    start(node, *small())
    reports = peer.subscribe(DiagnosticArray, '/diagnostics')
    publisher, sent = peer.advertise(Image, 'image_raw'), 0
    assert ready(peer, 'image_raw')

    def levels() -> list[bytes]:
        return [message.status[0].level for message in reports if reason in message.status[0].message]

    def blind(level: bytes) -> bool:
        nonlocal sent
        publisher.publish(make(sent))
        sent += 1
        peer.rest(0.1)
        return any(message.status[0].level == level and 'no image could be used' in message.status[0].message
                   and reason in message.status[0].message for message in reports)

    deadline = time.monotonic() + TIMEOUT_S
    while not blind(DiagnosticStatus.ERROR):
        assert time.monotonic() < deadline, [message.status[0].message for message in reports]
    found = levels()
    assert found.index(DiagnosticStatus.WARN) < found.index(DiagnosticStatus.ERROR)
    shown('images come, but none can be used', 'WARN with the reason after 2 s, ERROR after 5 s', name)


def test_a_stage_that_sees_again_is_well_again(peer, start):
    start('pipeline', *small(*PATIENT))
    reports, answers = peer.subscribe(DiagnosticArray, '/diagnostics'), peer.subscribe(PointCloud2, 'detections')
    publisher, sent = peer.advertise(Image, 'image_raw'), 0
    assert ready(peer, 'image_raw')

    def reaches(level: bytes, make: Callable[[int], Image]) -> bool:
        nonlocal sent
        publisher.publish(make(sent))
        sent += 1
        peer.rest(0.1)
        return bool(reports) and reports[-1].status[0].level == level

    for level, make in ((DiagnosticStatus.ERROR, uniform), (DiagnosticStatus.OK, flight)):
        deadline = time.monotonic() + TIMEOUT_S
        while not reaches(level, make):
            assert time.monotonic() < deadline, reports[-1].status[0].message
    assert peer.until(lambda: len(answers) == sent)
    assert stamp_ns(answers[-1].header) == sent * PERIOD_NS
