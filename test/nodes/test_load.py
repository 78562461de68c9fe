"""Work that follows the load: ``load.adapt`` of the node pipeline."""

from __future__ import annotations

import time
from typing import Any

from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus
from peers import Peer, picture, ready, small
from sensor_msgs.msg import Image

from motion_detect_ros.bridge.images import header_of, image_to_msg

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
