"""What a node tells its user on the console while nothing, or something, comes."""

from __future__ import annotations

import re
from pathlib import Path

import pytest
from peers import Peer, image_message, ready, small
from sensor_msgs.msg import CompressedImage, Image

from motion_detect_ros.cli.domains import own_domain

pytestmark = pytest.mark.messages

IMAGES = 20
#: What a stage says when nothing comes.
ELSEWHERE = r'no images on /front/\S+ for \d+ s; (.*)'


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


@pytest.mark.parametrize(('transport', 'waits'), [('raw', 'image_raw'), ('compressed', 'image_raw/compressed')])
def test_only_images_that_may_be_meant_are_named(transport: str, waits: str, start, tmp_path: Path):
    """A camera that waits offers both of its topics and publishes nothing; pictures for people are no images."""
    namespace = ('-r', '__ns:=/front')
    camera, other = Peer(own_domain(), '/front'), Peer(own_domain(), '/rear')
    start('pipeline', *small(f'image_transport:={transport}'), *namespace)
    start('overlay', *namespace, '-r', '__node:=pictures')
    log = tmp_path / 'pipeline.log'

    def told(words: str) -> bool:
        return camera.until(lambda: words in re.findall(ELSEWHERE, log.read_text()))

    try:
        camera.advertise(Image, 'image_raw')
        camera.advertise(CompressedImage, 'image_raw/compressed')
        other.advertise(Image, 'flow')
        assert camera.until(lambda: camera.node.count_publishers('/front/pictures/overlay/compressed'))
        assert ready(camera, waits)
        assert told('nobody publishes others')
        other.advertise(Image, 'overlay')
        assert told('images are published on /rear/overlay (Image)')
        name = '/front/image_raw' if transport == 'compressed' else '/front/image_raw/compressed'
        kind = Image if transport == 'compressed' else CompressedImage
        other.advertise(kind, name)
        assert told(f'images are published on {name} ({kind.__name__}), /rear/overlay (Image)')
    finally:
        camera.close()
        other.close()
