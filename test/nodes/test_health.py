"""Health of the nodes on /diagnostics while things go well, badly, or not at all."""

from __future__ import annotations

import itertools
from collections.abc import Iterator

import cv2
import numpy as np
import pytest
from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus
from peers import TIMEOUT_S, Peer, image_message, lossless, picture, ready, small
from sensor_msgs.msg import CompressedImage, Image, PointCloud2

from motion_detect_ros.benchmarks.jpeg_stream import JpegStream
from motion_detect_ros.bridge.images import stamp_ns
from motion_detect_ros.sources.bags import BagWriter

pytestmark = pytest.mark.messages

OK, WARN, ERROR = DiagnosticStatus.OK, DiagnosticStatus.WARN, DiagnosticStatus.ERROR


class Health:
    """The reports of one node, latest last."""

    def __init__(self, peer: Peer, node: str = '') -> None:
        """node: by default there is one."""
        self._peer, self._node = peer, node
        self._heard = peer.subscribe(DiagnosticArray, '/diagnostics')

    @property
    def _messages(self) -> list[DiagnosticArray]:
        return [each for each in self._heard if each.status[0].name == f'/{self._node}' or not self._node]

    @property
    def reports(self) -> list[tuple[bytes, str]]:
        return [(message.status[0].level, message.status[0].message) for message in self._messages]

    def next(self, count: int = 1) -> list[tuple[bytes, str]]:
        """The reports that come from now on."""
        before = len(self._messages)
        assert self._peer.until(lambda: len(self._messages) >= before + count)
        return self.reports[before:before + count]

    def reported(self, level: bytes, words: str, timeout_s: float = TIMEOUT_S) -> bool:
        """Whether such a report comes in time."""
        return self._peer.until(lambda: any(
            found == level and words in text for found, text in self.reports), timeout_s)

    def values(self) -> dict[str, str]:
        return {pair.key: pair.value for pair in self._messages[-1].status[0].values}


def test_overlay_that_nobody_subscribes_to_or_has_nothing_to_show_is_fine(peer, start):
    start('overlay')
    health = Health(peer)
    assert health.next() == [(OK, 'no subscribers')]
    peer.subscribe(Image, '/overlay/overlay')
    assert health.reported(OK, 'no publisher of image_raw, detections yet')
    publisher = peer.advertise(Image, 'image_raw')
    assert health.reported(OK, 'no publisher of detections yet')
    peer.advertise(PointCloud2, 'detections')
    assert ready(peer, 'image_raw')
    publisher.publish(image_message(0))
    assert health.reported(WARN, 'nothing received for')
    assert {level for level, text in health.reports if 'nothing received' not in text} == {OK}


def test_a_publisher_that_has_gone_stays_a_warning(peer, start):
    """The end of a bag, or of a driver: for the overlay as for the stage; what comes again is fine again."""
    start('pipeline', *small())
    start('overlay')
    health = {node: Health(peer, node) for node in ('pipeline', 'overlay')}
    drawn = peer.subscribe(Image, '/overlay/overlay')
    publisher = peer.advertise(Image, 'image_raw')
    assert ready(peer, 'image_raw', 2)
    count = itertools.count()

    def shown() -> bool:
        before = len(drawn)
        publisher.publish(image_message(next(count)))
        levels = [one.reports[-1][0] for one in health.values() if one.reports]
        return peer.until(lambda: len(drawn) > before, 0.5) and levels == [OK, OK]

    assert peer.until(shown)
    peer.node.destroy_publisher(publisher)
    for one in health.values():
        assert one.reported(WARN, 'nothing received for')
        assert {level for level, _ in one.next(4)} == {WARN}
        assert 'no publisher of image_raw any more' in one.reports[-1][1]
    publisher = peer.advertise(Image, 'image_raw')
    assert ready(peer, 'image_raw', 2)
    assert peer.until(shown)


def test_stage_warns_while_it_drops_and_recovers(peer, start):
    start('pipeline', *small('queue_size:=1'), *lossless('image_raw', 'detections'))
    answers, health = peer.subscribe(PointCloud2, 'detections'), Health(peer)
    publisher = peer.advertise(Image, 'image_raw')
    assert ready(peer, 'image_raw')
    images = [image_message(index) for index in range(12)]
    sent = 0

    def overloaded() -> bool:
        nonlocal sent
        for image in images:
            image.header.stamp.sec += 2
            publisher.publish(image)
        sent += len(images)
        return any(level == WARN and 'dropped since the last report' in text for level, text in health.reports)

    def counts() -> tuple[int, ...]:
        return tuple(int(health.values()[key]) for key in ('received', 'processed', 'dropped'))

    assert peer.until(overloaded)
    assert peer.until(lambda: counts()[0] == sent == counts()[1] + counts()[2]), (sent, counts())
    _, processed, dropped = counts()
    assert dropped > 0
    assert peer.until(lambda: len(answers) == processed)
    assert stamp_ns(answers[-1].header) == stamp_ns(images[-1].header)  # the newest image is never the one dropped

    def calm() -> bool:
        images[-1].header.stamp.sec += 1
        publisher.publish(images[-1])
        answered = len(answers) + 1
        return peer.until(lambda: len(answers) == answered) and health.reports[-1][0] == OK

    assert peer.until(calm)
    assert health.values()['dropped'] == str(dropped)


def test_stage_with_a_long_queue_warns_that_it_lags(peer, start):
    start('pipeline', '-p', 'queue_size:=200', '-p', 'image_transport:=compressed',
          '-p', 'preprocessing.max_width_px:=1280')
    health = Health(peer)
    publisher = peer.advertise(CompressedImage, 'image_raw/compressed')
    assert ready(peer, 'image_raw/compressed')
    _, jpeg = cv2.imencode('.jpg', cv2.resize(picture(0), (1280, 960)))
    large = CompressedImage(format='jpeg', data=jpeg.tobytes())

    def lags() -> bool:
        for _ in range(4):  # far faster than any machine computes them
            large.header.stamp.nanosec += 1_000_000
            publisher.publish(large)
        return any(level == WARN and 'images wait' in text for level, text in health.reports)

    assert peer.until(lags)


def test_values_name_what_a_stage_sees(peer, start):
    start('pipeline', *small())
    answers, health = peer.subscribe(PointCloud2, 'detections'), Health(peer)
    publisher = peer.advertise(Image, 'image_raw')
    assert ready(peer, 'image_raw')
    for index in range(3):
        publisher.publish(image_message(index))
        assert peer.until(lambda index=index: len(answers) > index)
    health.next()
    values = health.values()
    assert values['status'] == 'OK'
    assert 0 < int(values['inliers']) <= int(values['tracks'])
    assert 1 <= int(values['clusters']) <= 25
    assert (values['noise_floor_px'], values['initial_neurons'], values['max_neurons']) == ('0.200', '15', '25')
    assert values['last_error'] == ''
    wanted = {'rate_in_hz', 'rate_out_hz', 'dropped', 'latency_p50_ms', 'latency_p95_ms', 'stamp_age_ms', 'total_ms'}
    assert all(np.isfinite(float(values[key])) for key in wanted)


def test_inactive_node_is_fine(peer, start):
    start('ego_motion', *small('autostart:=false'))
    assert Health(peer).next() == [(OK, 'inactive')]


@pytest.fixture
def stream() -> Iterator[JpegStream]:
    with JpegStream([picture(index) for index in range(40)], rate_hz=30.0) as camera:
        yield camera


def test_camera_whose_stream_stalls_is_in_error_until_it_is_back(peer, start, stream, tmp_path):
    health, address = Health(peer), stream.address
    start('camera', '-p', f'source:={address}')
    assert health.reported(OK, 'Hz')
    stream.freeze()
    assert health.reported(ERROR, 'nothing received for')
    stream.cut()
    stream.flow()
    assert peer.until(lambda: int(health.values()['reconnects']) > 0)
    seen = len(health.reports)
    assert peer.until(lambda: OK in [level for level, _ in health.reports[seen:]])
    printed = (tmp_path / 'camera.log').read_text()
    opened, lost, back = (printed.index(words) for words in (
        f'opened {address}', f'{address}: nothing received for', f'{address}: pictures come again'))
    assert opened < lost < back


def test_player_waits_plays_and_reports_why_it_ends(peer, start, tmp_path):
    bag = tmp_path / 'flight.mcap'
    with BagWriter(bag) as writer:
        for index in range(3):
            writer.write_image(picture(index), (index + 1) * 1_000_000_000)
    health: Health = Health(peer)
    process = start('bag_player', '-p', f'bag:={bag}', '-p', 'wait_for_subscribers:=1', code=2)
    assert health.reported(OK, 'waiting for 1 subscribers of /image_raw, 0 so far')
    bag.unlink()
    peer.subscribe(Image, 'image_raw')
    assert health.reported(ERROR, f'{bag}: no such bag')
    assert peer.until(lambda: process.poll() is not None)


def test_player_warns_that_a_bag_is_damaged(peer, start, tmp_path):
    bag = tmp_path / 'flight.mcap'
    with BagWriter(bag, compress=False) as writer:
        for index in range(40):
            writer.write_image(picture(index), (index + 1) * 50_000_000)
    bag.write_bytes(bag.read_bytes()[:-4_000_000])
    peer.subscribe(Image, 'image_raw')
    health = Health(peer)
    start('bag_player', '-p', f'bag:={bag}', '-p', 'loop:=true')
    assert health.reported(WARN, 'cut off')


