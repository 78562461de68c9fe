"""How long after its image a planner has the detections, where images were recorded later than they were taken."""

from __future__ import annotations

import math
import time

import pytest
from peers import PATIENT, picture

from motion_detect_ros.cli.live import LiveGraph
from motion_detect_ros.sources import messages
from motion_detect_ros.sources.bags import BagWriter

pytestmark = pytest.mark.messages

PERIOD_NS = 100_000_000
FRAMES = 12


def test_latency_counts_from_the_image_whatever_its_stamp(tmp_path):
    """Each image is recorded when the one after the next is taken, as by a recorder 0.2 s behind."""
    path = tmp_path / 'late.mcap'
    with BagWriter(path) as writer:
        for index in range(FRAMES):
            writer.write('/image_raw', messages.image(picture(index), index * PERIOD_NS, 'eye'),
                         (index + 2) * PERIOD_NS)
    with LiveGraph('default', ('pipeline',), parameters=('preprocessing.max_width_px:=320', *PATIENT)) as graph:
        start = time.monotonic()
        playback = graph.play(path, FRAMES)
        longest_ms = 1e3 * (time.monotonic() - start)
    assert [message.stamp_ns for message in playback.received] == [index * PERIOD_NS for index in range(FRAMES)]
    assert all(math.isfinite(message.latency_ms) for message in playback.received)
    assert all(0.0 < message.latency_ms < longest_ms for message in playback.received)
    assert playback.published == FRAMES
