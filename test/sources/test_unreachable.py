"""Why a stream does not open, asked of servers on the loopback device."""

from __future__ import annotations

import socket
import threading
from collections.abc import Iterator

import pytest

from motion_detect_ros.sources.unreachable import why_unreachable


@pytest.fixture
def server() -> Iterator[socket.socket]:
    with socket.create_server(('127.0.0.1', 0)) as one:
        yield one


def port_of(server: socket.socket) -> int:
    return int(server.getsockname()[1])


def answering(server: socket.socket, answer: bytes) -> list[bytes]:
    """Answers one connection in a thread; what was asked."""
    asked = list[bytes]()

    def serve() -> None:
        connection, _ = server.accept()
        with connection:
            asked.append(connection.recv(1000))
            connection.sendall(answer)

    threading.Thread(target=serve, daemon=True).start()
    return asked


@pytest.mark.parametrize(('scheme', 'answer', 'words'), [
    ('rtsp', b'RTSP/1.0 401 Unauthorized\r\n\r\n',
     'the server asks for user and password (401): those given may be wrong'),
    ('http', b'HTTP/1.1 404 Not Found\r\n\r\n', 'the server has nothing under this path (404)'),
    ('http', b'HTTP/1.1 403 Forbidden\r\n\r\n', 'the server does not allow it (403)'),
    ('rtsp', b'RTSP/1.0 200 OK\r\n\r\n', ''), ('http', b'\xff\xfe\x00garbage', ''), ('http', b'', ''),
])
def test_answers_of_servers(server, scheme, answer, words):
    asked = answering(server, answer)
    assert why_unreachable(f'{scheme}://pilot:secret@127.0.0.1:{port_of(server)}/live?a=1') == words
    assert b'/live?a=1' in asked[0]
    assert b'secret' not in asked[0] and b'pilot' not in asked[0]


def test_nobody_there_and_nobody_who_answers(server):
    port = port_of(server)
    assert why_unreachable(f'rtsp://127.0.0.1:{port}/live') == f'no answer from 127.0.0.1:{port}'
    with socket.create_server(('127.0.0.1', 0)) as other:
        free = port_of(other)
    assert why_unreachable(f'rtsp://127.0.0.1:{free}/live') == 'connection refused'
    assert why_unreachable('rtsp://camera.invalid/live') == 'no address known for camera.invalid'


@pytest.mark.parametrize('source', ['0', 'udp://127.0.0.1:5000', 'rtsp://', 'rtsp://[::1', 'rtsp://host:99999/'])
def test_what_cannot_be_asked_has_no_reason(source):
    assert why_unreachable(source) == ''


def test_no_part_of_a_password_is_taken_for_the_host() -> None:
    with socket.create_server(('127.0.0.1', 0)) as server:
        port = port_of(server)
    assert why_unreachable(f'rtsp://admin:12/34@127.0.0.1:{port}/live') == 'connection refused'


@pytest.mark.parametrize('address', [
    'http://127.0.0.1:{port}/live?mail=me@host.invalid', 'http://me:pw@127.0.0.1:{port}/live?mail=me@host.invalid',
    'http://me:p/w@127.0.0.1:{port}/live?mail=me@host.invalid', 'http://me:p@w@127.0.0.1:{port}/live'])
def test_an_at_sign_in_the_query_is_no_host(server, address):
    asked = answering(server, b'HTTP/1.1 404 Not Found\r\n\r\n')
    assert why_unreachable(address.format(port=port_of(server))) == 'the server has nothing under this path (404)'
    assert b'Host: 127.0.0.1\r\n' in asked[0]


def test_an_at_sign_in_the_path_of_a_plain_host_is_no_host():
    assert why_unreachable('http://host.invalid/a@127.0.0.1:9/live') == 'no address known for host.invalid'
