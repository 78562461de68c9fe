"""The camera has its device while it is active, and neither before nor after."""

from __future__ import annotations

import threading
import time
from collections.abc import Iterator
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer

import cv2
import pytest
from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus
from lifecycle_msgs.msg import State, Transition
from lifecycle_msgs.srv import ChangeState, GetState
from peers import picture
from sensor_msgs.msg import Image


class Stream(BaseHTTPRequestHandler):
    """MJPEG without end; the server counts who is connected."""

    def do_GET(self) -> None:
        self.send_response(200)
        self.send_header('Content-Type', 'multipart/x-mixed-replace; boundary=frame')
        self.end_headers()
        data = cv2.imencode('.jpg', picture(0))[1].tobytes()
        self.server.connections += 1
        try:
            while True:
                self.wfile.write(b'--frame\r\nContent-Type: image/jpeg\r\nContent-Length: %d\r\n\r\n' % len(data))
                self.wfile.write(data + b'\r\n')
                time.sleep(0.02)
        except OSError:
            self.server.connections -= 1

    def log_message(self, *_: object) -> None:
        pass


@pytest.fixture
def stream() -> Iterator[ThreadingHTTPServer]:
    with ThreadingHTTPServer(('127.0.0.1', 0), Stream) as server:
        server.daemon_threads, server.connections = True, 0
        threading.Thread(target=server.serve_forever, daemon=True).start()
        yield server
        server.shutdown()


def change(peer, transition: int) -> bool:
    return peer.call(ChangeState, '/camera/change_state', transition=Transition(id=transition)).success


def state(peer) -> int:
    return peer.call(GetState, '/camera/get_state').current_state.id


def test_the_device_is_open_while_the_node_is_active(peer, start, stream):
    images = peer.subscribe(Image, 'image_raw')
    address = f'http://127.0.0.1:{stream.server_port}/stream.mjpg'
    start('camera', '-p', 'autostart:=false', '-p', f'source:={address}')
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
