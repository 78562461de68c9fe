"""A failure of a wait for messages tells which came."""

from __future__ import annotations

import pytest
from peers import all_came
from sensor_msgs.msg import Image

from motion_detect_ros.bridge.images import header_of


@pytest.mark.parametrize(('sent', 'said'), [
    ((1, 2), r'came: \[1, 2\]; missing: \[3\]; too many: \[\]'),
    ((1, 2, 2, 3), r'came: \[1, 2, 2, 3\]; missing: \[\]; too many: \[2\]'),
    ((1, 3, 2), r'came: \[1, 3, 2\]; missing: \[\]; too many: \[\]'),
    ((1, 2, 3), ''),
], ids=['lost', 'twice', 'out of order', 'right'])
def test_stamps_that_came_are_named(peer, sent, said):
    received, publisher = peer.subscribe(Image, 'image_raw'), peer.advertise(Image, 'image_raw')
    assert peer.until(lambda: publisher.get_subscription_count() == 1)
    for stamp in sent:
        publisher.publish(Image(header=header_of(stamp, 'eye')))
    assert peer.until(lambda: len(received) == len(sent))
    if not said:
        all_came(peer, received, [1, 2, 3])
        return
    with pytest.raises(AssertionError, match=said):
        all_came(peer, received, [1, 2, 3], timeout_s=0.5)
