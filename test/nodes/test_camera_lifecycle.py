"""The camera has its device while it is active, and neither before nor after."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
import pytest
from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus
from lifecycle_msgs.msg import State, Transition
from lifecycle_msgs.srv import ChangeState, GetState
from peers import picture
from sensor_msgs.msg import Image

from motion_detect_ros.benchmarks.jpeg_stream import JpegStream
from motion_detect_ros.bridge.images import image_from_msg

pytestmark = pytest.mark.messages


@pytest.fixture
def stream() -> Iterator[JpegStream]:
    with JpegStream([picture(0)], rate_hz=50.0) as camera:
        yield camera


def change(peer, transition: int) -> bool:
    return peer.call(ChangeState, '/camera/change_state', transition=Transition(id=transition)).success


def state(peer) -> int:
    return peer.call(GetState, '/camera/get_state').current_state.id


def test_the_device_is_open_while_the_node_is_active(peer, start, stream):
    images = peer.subscribe(Image, 'image_raw')
    start('camera', '-p', 'autostart:=false', '-p', f'source:={stream.address}')
    assert change(peer, Transition.TRANSITION_CONFIGURE)
    assert stream.connections == 0
    for _ in range(2):
        images.clear()
        assert change(peer, Transition.TRANSITION_ACTIVATE)
        assert peer.until(lambda: len(images) > 3)
        assert stream.connections == 1
        assert change(peer, Transition.TRANSITION_DEACTIVATE)
        assert peer.until(lambda: stream.connections == 0)


def test_a_wrong_source_makes_activation_fail_with_its_reason(peer, start):
    reports = peer.subscribe(DiagnosticArray, '/diagnostics')
    process = start('camera', '-p', 'autostart:=false', '-p', 'source:=87')
    assert change(peer, Transition.TRANSITION_CONFIGURE)
    for _ in range(2):
        assert not change(peer, Transition.TRANSITION_ACTIVATE)
        assert state(peer) == State.PRIMARY_STATE_INACTIVE
        before = len(reports)
        assert peer.until(lambda before=before: len(reports) > before)
        status = reports[-1].status[0]
        assert (status.level, status.message) == (DiagnosticStatus.ERROR, '87: cannot be opened as a camera')
    assert process.poll() is None


#: Black pictures that are sent first, and pictures that may be on their way to the node.
BLACK, ON_THE_WAY = 100, 50


def test_pictures_from_before_the_subscribers_are_not_published(peer, start):
    """The device is opened at once; what waits in its driver meanwhile would get the stamp of now."""
    black, white = np.zeros((48, 64), np.uint8), np.full((48, 64), 255, np.uint8)
    with JpegStream([black] * BLACK + [white] * 10_000, rate_hz=50.0) as stream:
        start('camera', '-p', f'source:={stream.address}', '-p', 'wait_for_subscribers:=1')
        assert peer.until(lambda: stream.sent > BLACK + ON_THE_WAY)
        images = peer.subscribe(Image, 'image_raw')
        assert peer.until(lambda: images)
    assert image_from_msg(images[0]).min() > 250
