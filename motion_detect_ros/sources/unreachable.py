"""Why a network stream does not open: what OpenCV does not say, asked of the server."""

from __future__ import annotations

import contextlib
import socket
from urllib.parse import SplitResult, quote, urlsplit

from motion_detect_ros.sources.secrets import until_path

#: How long the server may take to connect, and to answer, seconds.
TIMEOUT_S = 1.0
_PORTS = {'rtsp': 554, 'http': 80, 'rtsps': 322, 'https': 443, 'rtmp': 1935}
_LONGEST_LINE = 200
_MEANINGS = {'403': 'the server does not allow it (403)', '404': 'the server has nothing under this path (404)'}


def why_unreachable(address: str) -> str:
    """In a few words why there are no pictures; empty where the server is there and does not say.

    The user and the password of the address are not sent. Takes 2 ``TIMEOUT_S`` at most, if names are resolved at once.
    """
    with contextlib.suppress(ValueError):  # an address or port that is none
        parts = urlsplit(_readable(address))
        if parts.hostname and parts.scheme in _PORTS:
            return _asked(parts, parts.hostname, parts.port or _PORTS[parts.scheme])
    return ''


def _readable(address: str) -> str:
    """The address with user and password quoted: a slash in them would end the host's name."""
    scheme, separator, rest = address.partition('://')
    authority, before_query = until_path(rest), rest.partition('?')[0]
    if '@' not in authority and (':' not in authority or '@' not in before_query):
        return address  # what is before the path is the host: without a colon there is no password in which it ends
    secret, at, place = (before_query if '@' in before_query else rest).rpartition('@')
    return f'{scheme}{separator}{quote(secret, safe=":")}{at}{place}{rest[len(secret + at + place):]}'


def _asked(parts: SplitResult, host: str, port: int) -> str:
    try:
        with socket.create_connection((host, port), TIMEOUT_S) as connection:
            request = _request(parts, host)
            if not request:
                return ''
            connection.settimeout(TIMEOUT_S)
            connection.sendall(request)
            return _meaning(connection.recv(_LONGEST_LINE), parts)
    except TimeoutError:
        return f'no answer from {host}:{port}'
    except socket.gaierror:
        return f'no address known for {host}'
    except OSError as error:
        return (error.strerror or str(error)).lower()


def _request(parts: SplitResult, host: str) -> bytes:
    path = f'{parts.path or "/"}?{parts.query}'.rstrip('?')
    if parts.scheme == 'rtsp':
        location = f'rtsp://{parts.netloc.rpartition("@")[2]}{path}'
        return f'DESCRIBE {location} RTSP/1.0\r\nCSeq: 1\r\nAccept: application/sdp\r\n\r\n'.encode()
    return f'HEAD {path} HTTP/1.0\r\nHost: {host}\r\n\r\n'.encode() if parts.scheme == 'http' else b''


def _meaning(answer: bytes, parts: SplitResult) -> str:
    """Of the first line: ``RTSP/1.0 401 Unauthorized``."""
    words = answer.decode('ascii', 'replace').splitlines()[:1]
    status = words[0].split()[1:2] if words else []
    if status == ['401']:
        given = ': those given may be wrong' if parts.username else ''
        return f'the server asks for user and password (401){given}'
    return _MEANINGS.get(status[0], '') if status else ''
