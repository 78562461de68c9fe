"""User and password of a camera: nothing that a node prints, logs, reports or answers shows them."""

from __future__ import annotations

import base64
import threading
from collections.abc import Iterator
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from pathlib import Path

import cv2
import pytest
from diagnostic_msgs.msg import DiagnosticArray
from peers import TIMEOUT_S, own_lines, picture
from rcl_interfaces.msg import Log, ParameterEvent
from rcl_interfaces.srv import GetParameters
from rclpy.qos import QoSDurabilityPolicy, QoSProfile
from sensor_msgs.msg import Image

from motion_detect_ros.sources.secrets import SECRET_VARIABLE

pytestmark = pytest.mark.messages

USER, PASSWORD = 'pilot', 'xQ7-hunter'
PERIOD_S = 0.05


class Guarded(BaseHTTPRequestHandler):
    """An MJPEG stream for those who know the password, until it is over: then everybody is refused."""

    over = threading.Event()

    def do_GET(self) -> None:
        expected = 'Basic ' + base64.b64encode(f'{USER}:{PASSWORD}'.encode()).decode()
        if self.headers.get('Authorization') != expected or self.over.is_set():
            self.send_response(401)
            self.send_header('WWW-Authenticate', 'Basic realm="camera"')
            self.end_headers()
            return
        self.send_response(200)
        self.send_header('Content-Type', 'multipart/x-mixed-replace; boundary=frame')
        self.end_headers()
        _, data = cv2.imencode('.jpg', picture(0))
        while not self.over.wait(PERIOD_S):
            self.wfile.write(b'--frame\r\nContent-Type: image/jpeg\r\nContent-Length: %d\r\n\r\n' % data.size)
            self.wfile.write(data.tobytes() + b'\r\n')

    def log_message(self, *_: object) -> None:
        pass


@pytest.fixture
def server() -> Iterator[str]:
    """Host and port."""
    Guarded.over.clear()
    with ThreadingHTTPServer(('127.0.0.1', 0), Guarded) as one:
        one.daemon_threads = True
        threading.Thread(target=one.serve_forever, daemon=True).start()
        yield f'127.0.0.1:{one.server_address[1]}'
        one.shutdown()


@pytest.mark.parametrize('way', ['address', 'file', 'environment'])
def test_credentials_open_the_camera_and_are_shown_nowhere(way, server, peer, start, tmp_path, monkeypatch, shown):
    source = f'http://{server}/live.mjpg'
    arguments = []
    if way == 'address':
        source = source.replace('//', f'//{USER}:{PASSWORD}@')
    elif way == 'file':
        (tmp_path / 'secret').write_text(f'{USER}:{PASSWORD}\n')
        arguments = ['-p', f'source_secret_file:={tmp_path / "secret"}']
    else:
        monkeypatch.setenv(SECRET_VARIABLE, f'{USER}:{PASSWORD}')
    quality = QoSProfile(depth=100, durability=QoSDurabilityPolicy.TRANSIENT_LOCAL)
    heard: list[object] = []
    peer.node.create_subscription(Log, '/rosout', heard.append, quality)
    peer.node.create_subscription(ParameterEvent, '/parameter_events', heard.append, 100)
    peer.node.create_subscription(DiagnosticArray, '/diagnostics', heard.append, 100)
    images = peer.subscribe(Image, 'image_raw')
    start('camera', '-p', f'source:={source}', '-p', 'wait_for_subscribers:=1', *arguments)
    assert peer.until(lambda: images)
    answer = peer.call(GetParameters, '/camera/get_parameters', names=['source', 'source_secret_file'])
    value = answer.values[0].string_value
    assert value.endswith(f'{server}/live.mjpg')
    assert ('***@' in value) == (way == 'address')
    Guarded.over.set()
    assert peer.until(lambda: any(message.status[0].level == b'\x02' for message in heard
                                  if isinstance(message, DiagnosticArray)))
    everything = str(heard) + str(answer) + (tmp_path / 'camera.log').read_text()
    assert len(heard) > 2
    assert PASSWORD not in everything
    assert USER not in everything.replace(str(tmp_path), '')
    shown('user and password in the address of a camera',
          'in no line of stderr, /rosout, /diagnostics, /parameter_events, get_parameters', f'by {way}: found in none')


@pytest.mark.parametrize('source', [
    f'rtsp://{USER}:{PASSWORD}@127.0.0.1:9/live', f'http://127.0.0.1:9/live?user={USER}&password={PASSWORD}'])
def test_an_address_that_cannot_be_opened_is_named_without_its_password(source: str, start, tmp_path: Path):
    assert start('camera', '-p', f'source:={source}', code=2).wait(TIMEOUT_S) == 2
    printed = (tmp_path / 'camera.log').read_text()
    assert '127.0.0.1:9/live' in printed
    assert PASSWORD not in printed
    assert len(own_lines(printed)) == 1


def test_a_source_that_is_empty_is_refused(start, tmp_path: Path):
    assert start('camera', '-p', "source:=''", code=2).wait(TIMEOUT_S) == 2
    printed = (tmp_path / 'camera.log').read_text()
    assert 'source: expected a camera number, a path or an address, got nothing' in printed
