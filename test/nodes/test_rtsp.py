"""The camera node on a real RTSP link, that of a drone: H.264 over the loopback device, lost and found again."""

from __future__ import annotations

import signal
import time
from collections.abc import Iterator
from itertools import pairwise
from pathlib import Path

import cv2
import pytest
from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus
from peers import TIMEOUT_S, Peer, own_lines, picture, small
from rtsp import FPS, PACKAGES, RtspServer, number_of, numbered, serves
from sensor_msgs.msg import Image, PointCloud2

from motion_detect_ros.bridge.images import image_from_msg, stamp_ns
from motion_detect_ros.bridge.records import read_detections
from motion_detect_ros.sources.live import FIRST_BACK_OFF_S, OPEN_TIMEOUT_MS, TIMEOUT_MS
from motion_detect_ros.sources.video import open_capture

#: Pictures of a server, more than a test takes; those of the next server begin at NEXT.
FRAMES, NEXT = 500, 512
#: Pictures of the block on its way across the ground.
PLAIN_FRAMES = 40
#: How long a lost link stays lost, seconds.
OUTAGE_S = 2.0
#: In which there is a report of the diagnostics, seconds.
ONE_REPORT_S = 20.0
#: From the return of a server to the next picture: what the back-off may have grown to, and as much as the user waits.
RESUME_S = OUTAGE_S + FIRST_BACK_OFF_S + 1.0


def write_plain(folder: Path) -> Path:
    """A folder of pictures of the drifting ground with its block."""
    folder.mkdir()
    for index in range(PLAIN_FRAMES):
        cv2.imwrite(str(folder / f'{index:03d}.jpg'), picture(index), [cv2.IMWRITE_JPEG_QUALITY, 95])
    return folder


def write(folder: Path, first: int, scale: int = 1) -> Path:
    """A folder of the same with numbers in them."""
    folder.mkdir()
    for index in range(FRAMES):
        cv2.imwrite(str(folder / f'{index:03d}.jpg'), numbered(first + index, scale), [cv2.IMWRITE_JPEG_QUALITY, 95])
    return folder


@pytest.fixture(scope='module')
def pictures(tmp_path_factory: pytest.TempPathFactory) -> dict[str, Path]:
    """Folders of pictures by name: without numbers, of one server, of the next, and larger ones."""
    if not serves():
        pytest.skip(f'no RTSP server: apt install {PACKAGES}')
    folder = tmp_path_factory.mktemp('rtsp')
    return {'plain': write_plain(folder / 'plain'), 'first': write(folder / 'first', 0),
            'next': write(folder / 'next', NEXT), 'larger': write(folder / 'larger', NEXT, 2)}


@pytest.fixture
def server(pictures: dict[str, Path]) -> Iterator[RtspServer]:
    """Of the first pictures; not yet started."""
    one = RtspServer(pictures['first'])
    yield one
    one.close()


class Watched:
    """What a camera node says and sends."""

    def __init__(self, peer: Peer) -> None:
        self._peer = peer
        self.images = peer.subscribe(Image, 'image_raw', 1000)
        self._reports = peer.subscribe(DiagnosticArray, '/diagnostics')

    def reported(self, level: bytes, words: str) -> bool:
        return any(status.name == '/camera' and status.level == level and words in status.message
                   for report in self._reports for status in report.status)

    def value(self, key: str) -> str:
        """The latest of a key of the diagnostics; empty before the first."""
        return next((pair.value for report in reversed(self._reports) for status in report.status
                     for pair in status.values if status.name == '/camera' and pair.key == key), '')

    def numbers(self) -> list[int]:
        """Those of all pictures so far that can be read, in the order of arrival."""
        numbers = [number_of(image_from_msg(message)) for message in self.images]
        return [number for number in numbers if number is not None]

    def more(self, count: int = FPS, width: int = 0) -> bool:
        """True once so many more pictures came, of that width if given."""
        seen = len(self.images)
        return self._peer.until(
            lambda: sum(one.width == (width or one.width) for one in self.images[seen:]) >= count)

    def forget(self) -> None:
        """The reports so far."""
        self._reports.clear()


@pytest.fixture
def watched(peer: Peer) -> Watched:
    return Watched(peer)


def test_what_moves_on_the_link_is_found(peer, start, server, watched, pictures):
    server.start(pictures['plain'])
    answers = peer.subscribe(PointCloud2, 'detections')
    start('pipeline', *small('queue_size:=100'))
    assert peer.until(lambda: peer.node.count_publishers('detections') == 1)
    start('camera', '-p', f'source:={server.address}')

    def block_found() -> bool:
        """The block of 60 x 50 pixels, wherever it is by now."""
        return any(45 < one['width'] < 75 and 35 < one['height'] < 65 for message in answers[-5:]
                   for one in read_detections(message))

    assert peer.until(block_found)
    assert image_from_msg(watched.images[-1]).shape == (240, 320, 3)
    assert 0 < time.time_ns() - stamp_ns(watched.images[0].header) < TIMEOUT_S * 1e9, 'stamped when it arrived'
    assert peer.until(lambda: watched.reported(DiagnosticStatus.OK, 'Hz'))


def test_a_killed_server_comes_back_with_larger_pictures(peer, start, server, watched, pictures, shown):
    server.start()
    answers = peer.subscribe(PointCloud2, 'detections')
    start('pipeline', *small('queue_size:=100'))
    assert peer.until(lambda: peer.node.count_publishers('detections') == 1)
    start('camera', '-p', f'source:={server.address}')
    assert watched.more()
    server.kill()
    assert peer.until(lambda: watched.reported(DiagnosticStatus.ERROR, 'nothing received for'))
    assert peer.until(lambda: watched.reported(DiagnosticStatus.ERROR, 'connection refused'))
    server.start(pictures['larger'])
    assert watched.more(width=640)
    assert peer.until(lambda: int(watched.value('reconnects')) > 0)
    first_ns = min(stamp_ns(message.header) for message in watched.images if message.width == 640)
    assert peer.until(lambda: sum(stamp_ns(answer.header) >= first_ns for answer in answers) > 5)
    watched.forget()
    assert peer.until(lambda: watched.reported(DiagnosticStatus.OK, 'Hz'))
    numbers = watched.numbers()
    assert len(numbers) > FPS
    assert numbers == sorted(set(numbers)), 'a picture came twice, or late'
    assert stamps_increase(watched)
    shown('an RTSP camera is killed and comes back with a larger picture',
          'ERROR with the reason, then new pictures only, and they are answered',
          f'{len(numbers)} pictures, none twice')


def stamps_increase(watched: Watched) -> bool:
    stamps = [stamp_ns(message.header) for message in watched.images]
    return stamps == sorted(set(stamps))


def test_a_frozen_server_is_left_and_found_again(peer, start, server, watched, shown):
    server.start()
    start('camera', '-p', f'source:={server.address}')
    assert watched.more()
    server.send(signal.SIGSTOP)
    assert peer.until(lambda: watched.reported(DiagnosticStatus.ERROR, 'nothing received for'))
    assert peer.until(lambda: watched.reported(DiagnosticStatus.ERROR, 'no answer'))
    server.send(signal.SIGCONT)
    assert watched.more()
    numbers = watched.numbers()
    assert len(numbers) > FPS
    back = sum(later <= earlier for earlier, later in pairwise(numbers))
    # the server begins anew for each connection
    assert peer.until(lambda: back <= int(watched.value('reconnects')), ONE_REPORT_S), (
        f'a picture came twice, or late: {watched.value("reconnects")} new connections, {numbers}')
    assert stamps_increase(watched)
    shown('an RTSP camera answers no more and keeps its connection', 'ERROR with the reason, then new pictures only',
          f'{len(numbers)} pictures, none twice')


def test_a_slow_camera_is_no_lost_one(peer, start, server, watched, shown):
    server.start(fps=1)
    start('camera', '-p', f'source:={server.address}')
    assert watched.more(5)
    assert peer.until(lambda: watched.reported(DiagnosticStatus.OK, 'Hz'))
    watched.forget()
    assert watched.more(5)
    assert not watched.reported(DiagnosticStatus.ERROR, '')
    assert watched.value('reconnects') == '0'
    shown('an RTSP camera sends one picture a second', 'OK, no reconnect', '10 pictures')


@pytest.mark.parametrize(('credentials', 'words'), [
    ('', 'the server asks for user and password (401)'),
    ('pilot:wrong@', 'the server asks for user and password (401): those given may be wrong'),
], ids=['none', 'wrong'])
def test_a_wrong_password_is_named(peer, start, server, tmp_path, credentials, words, shown):
    server.start(credentials='pilot:secret')
    address = server.address.replace('//', f'//{credentials}')
    start('camera', '-p', f'source:={address}', code=2).wait(TIMEOUT_S)
    shown_address = server.address.replace('//', '//***@' if credentials else '//')
    printed = own_lines((tmp_path / 'camera.log').read_text())
    assert printed == [f'{shown_address}: cannot be opened as a video: {words}']
    shown('no or a wrong password for an RTSP camera', 'one line that says so, exit code 2', 'named')


def test_the_right_password_opens_and_one_that_is_changed_is_named(peer, start, server, watched):
    server.start(credentials='pilot:secret')
    start('camera', '-p', f'source:={server.address.replace("//", "//pilot:secret@")}')
    assert watched.more()
    server.kill()
    server.start(credentials='pilot:changed')
    assert peer.until(lambda: watched.reported(DiagnosticStatus.ERROR, 'the server asks for user and password (401)'))


@pytest.mark.timing
@pytest.mark.parametrize('how', ['killed', 'frozen'])
def test_pictures_come_again_soon_after_the_server(peer, start, server, watched, pictures, how, shown):
    server.start()
    start('camera', '-p', f'source:={server.address}')
    assert watched.more()
    began = time.monotonic()
    assert open_capture(server.address, TIMEOUT_MS, OPEN_TIMEOUT_MS).read()[0]
    opening_s = time.monotonic() - began
    if how == 'killed':
        server.kill()
    else:
        server.send(signal.SIGSTOP)
        assert peer.until(lambda: watched.reported(DiagnosticStatus.ERROR, 'nothing received for'))
    peer.rest(OUTAGE_S)
    if how == 'killed':
        server.start(pictures['next'])
    else:
        server.send(signal.SIGCONT)
    began = time.monotonic()
    assert watched.more(1)
    took_s = time.monotonic() - began
    assert took_s < RESUME_S + opening_s + (TIMEOUT_MS / 1e3 if how == 'frozen' else 0.0)
    shown('an RTSP camera comes back after 2 s', 'pictures within the back-off and 1 s, besides what the server takes',
          f'{how}: {took_s:.1f} s, of which the server took {opening_s:.1f} s')
