"""What a node tells its user on the console while nothing, or something, comes."""

from __future__ import annotations

import re
from pathlib import Path

from peers import Peer, image_message, ready, small
from sensor_msgs.msg import CompressedImage, Image

IMAGES = 20


def test_a_stage_tells_what_it_waits_for_and_what_came(peer: Peer, start, tmp_path: Path):
    process = start('pipeline', *small(
        'qos_overrides./image_raw.subscription.depth:=100',
        'qos_overrides./camera_info.subscription.reliability:=best_effort'))
    log = tmp_path / 'pipeline.log'

    def told(words: str) -> bool:
        return peer.until(lambda: re.search(words, log.read_text()) or process.poll() is not None)

    publisher = peer.advertise(Image, 'image_raw')
    assert ready(peer, 'image_raw')
    assert told(r'configured in \d+\.\d s, active: subscribes to /camera_info \(best effort, depth 5\), '
                r'/image_raw \(reliable, depth 100\); publishes .*/ego_motion \(reliable, depth 5\)')
    assert told(r'no images on /image_raw for \d+ s; nobody publishes others')
    peer.advertise(CompressedImage, 'elsewhere/compressed')
    assert told(r'no images on /image_raw for \d+ s; images are published on /elsewhere/compressed \(CompressedImage\)')
    for index in range(IMAGES):
        publisher.publish(image_message(index))
    assert told(r"first image on /image_raw: 320x240 bgr8, frame_id 'front'")
    assert told(r'images on /image_raw come at \d+\.\d Hz')
    assert len(re.findall('first image', log.read_text())) == 1
