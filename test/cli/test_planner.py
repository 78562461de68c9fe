"""Latency as the planner hears it, from messages that have waited for it."""

from __future__ import annotations

import contextlib
import math
import threading
import time

import pytest

pytest.importorskip('rclpy', reason='ROS 2 is not installed')

from peers import Peer

from motion_detect_ros.bridge.images import header_of
from motion_detect_ros.bridge.topics import CLOCK, DETECTIONS
from motion_detect_ros.cli.domains import own_domain
from motion_detect_ros.cli.planner import Planner
from motion_detect_ros.core.types import empty_detections

pytestmark = pytest.mark.messages

BETWEEN_S = 1.0
#: What the clock shows before the images of these stamps; that of stamp 300 is not shown.
CLOCK_OF = {100: 1, 200: 2, 300: 3}


def test_latency_counts_from_a_tick_that_is_handled_after_its_answer():
    """The planner is held up while the clock shows 2 and the answer comes: of the two it takes the answer first."""
    domain, let_go = own_domain(), threading.Event()
    with Planner(domain) as planner, contextlib.closing(Peer(domain)) as peer:
        ticks = peer.advertise(CLOCK.kind, CLOCK.name)
        answers = peer.advertise(DETECTIONS.kind, DETECTIONS.name)
        assert peer.matched(CLOCK.name, 1)
        assert peer.matched(DETECTIONS.name, 1)
        planner.expect(CLOCK_OF)
        ticks.publish(CLOCK.to_msg(1, None))
        answers.publish(answer(100))
        assert peer.until(lambda: planner.published == 1 and planner.answers == 1)  # each has found the other

        planner.watch = let_go.wait
        answers.publish(answer(300))
        assert peer.until(lambda: planner.answers == 2)
        start = time.monotonic()
        ticks.publish(CLOCK.to_msg(2, None))
        time.sleep(BETWEEN_S)
        answers.publish(answer(200))
        time.sleep(BETWEEN_S)
        let_go.set()
        assert planner.wait_for(3, 60.0)
        longest_ms = 1e3 * (time.monotonic() - start)
        assert peer.until(lambda: planner.published == 2)
    without, late = planner.received[1:]
    assert (without.stamp_ns, late.stamp_ns) == (300, 200)
    assert math.isnan(without.latency_ms)
    assert 1e3 * BETWEEN_S < late.latency_ms < longest_ms


def answer(stamp_ns):
    return DETECTIONS.to_msg(empty_detections(), header_of(stamp_ns, 'front'))
