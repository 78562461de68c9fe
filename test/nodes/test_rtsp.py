"""The camera node on a real RTSP link, that of a drone: H.264 over the loopback device, lost and found again."""

from __future__ import annotations

import socket
import subprocess
import time
from collections.abc import Callable, Iterator
from pathlib import Path

import cv2
import pytest
from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus
from peers import TIMEOUT_S, picture, small
from sensor_msgs.msg import Image, PointCloud2

from motion_detect_ros.bridge.images import image_from_msg, stamp_ns
from motion_detect_ros.bridge.records import read_detections

#: GStreamer's Python bindings belong to the system's Python.
PYTHON = Path('/usr/bin/python3')
SERVER = Path(__file__).with_name('rtsp_server.py')
NEEDS = ('import gi; gi.require_version("Gst", "1.0"); gi.require_version("GstRtspServer", "1.0"); '
         'from gi.repository import Gst, GstRtspServer; Gst.init(None); '
         'assert all(Gst.ElementFactory.find(n) for n in ("jpegdec", "x264enc", "rtph264pay"))')
PACKAGES = 'gir1.2-gst-rtsp-server-1.0 python3-gi gstreamer1.0-plugins-good gstreamer1.0-plugins-ugly'
FRAMES, FPS = 40, 10


def serves() -> bool:
    """Whether this machine can be an RTSP server."""
    return PYTHON.exists() and subprocess.run(
        [PYTHON, '-c', NEEDS], capture_output=True, check=False, timeout=60).returncode == 0


@pytest.fixture
def serve(tmp_path: Path) -> Iterator[Callable[[int], subprocess.Popen[str]]]:
    """``serve(port)`` starts a server of the drifting ground with its block."""
    if not serves():
        pytest.skip(f'no RTSP server: apt install {PACKAGES}')
    folder = tmp_path / 'pictures'
    folder.mkdir()
    for index in range(FRAMES):
        cv2.imwrite(str(folder / f'{index:03d}.jpg'), picture(index), [cv2.IMWRITE_JPEG_QUALITY, 95])
    running: list[subprocess.Popen[str]] = []

    def begin(port: int) -> subprocess.Popen[str]:
        process = subprocess.Popen([PYTHON, SERVER, folder, str(port), str(FPS)], stdout=subprocess.PIPE, text=True)
        running.append(process)
        assert process.stdout is not None
        assert process.stdout.readline() == 'ready\n'
        return process

    yield begin
    for process in running:
        process.kill()
        process.wait(TIMEOUT_S)


def free_port() -> int:
    with socket.socket() as one:
        one.bind(('127.0.0.1', 0))
        return int(one.getsockname()[1])


def test_link_is_found_watched_lost_and_found_again(peer, start, serve):
    port = free_port()
    server = serve(port)
    images, answers = peer.subscribe(Image, 'image_raw'), peer.subscribe(PointCloud2, 'detections')
    reports = peer.subscribe(DiagnosticArray, '/diagnostics')

    def reported(level: bytes, words: str) -> bool:
        return any(status.name == '/camera' and status.level == level and words in status.message
                   for report in reports for status in report.status)

    start('pipeline', *small('queue_size:=100'))
    assert peer.until(lambda: peer.node.count_publishers('detections') == 1)
    start('camera', '-p', f'source:=rtsp://127.0.0.1:{port}/drone')

    def block_found() -> bool:
        """The block of 60 x 50 pixels, wherever it is by now."""
        return any(45 < one['width'] < 75 and 35 < one['height'] < 65 for message in answers[-5:]
                   for one in read_detections(message))

    assert peer.until(block_found)
    assert image_from_msg(images[-1]).shape == (240, 320, 3)
    assert 0 < time.time_ns() - stamp_ns(images[0].header) < TIMEOUT_S * 1e9, 'stamped when it arrived'
    assert peer.until(lambda: reported(DiagnosticStatus.OK, 'Hz'))

    server.kill()
    server.wait(TIMEOUT_S)
    assert peer.until(lambda: reported(DiagnosticStatus.ERROR, 'nothing received for'))
    seen = len(images)
    serve(port)
    assert peer.until(lambda: len(images) > seen + FPS)
    assert peer.until(lambda: any(pair.key == 'reconnects' and int(pair.value) > 0 for report in reports[-3:]
                                  for status in report.status for pair in status.values))
