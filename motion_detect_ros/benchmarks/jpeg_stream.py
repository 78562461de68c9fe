"""A network camera on the loopback device: JPEG pictures over HTTP, which can be cut and frozen."""

from __future__ import annotations

import itertools
import select
import threading
import time
from collections.abc import Sequence
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from typing import Any

import cv2

from motion_detect_ros.core.types import ByteArray

#: How often a frozen stream looks whether it is cut or nobody listens any more, seconds.
POLL_S = 0.05
_PART = b'--frame\r\nContent-Type: image/jpeg\r\nContent-Length: %d\r\n\r\n%s\r\n'


class JpegStream:
    """Serves pictures again and again at a fixed rate under ``address``; use as a context manager.

    images: (H, W) or (H, W, 3) uint8 each. ``sent``: pictures sent so far, on all connections.
    """

    def __init__(self, images: Sequence[ByteArray], rate_hz: float) -> None:
        jpegs = [cv2.imencode('.jpg', image)[1].tobytes() for image in images]
        handler = self._handler([_PART % (len(jpeg), jpeg) for jpeg in jpegs], rate_hz)
        self._generation = 0
        self.sent = 0
        self._served = set[BaseHTTPRequestHandler]()
        self._frozen, self._refusing = threading.Event(), threading.Event()
        self._server = ThreadingHTTPServer(('127.0.0.1', 0), handler)
        self._server.daemon_threads = True
        self._thread = threading.Thread(target=self._server.serve_forever, daemon=True)

    def __enter__(self) -> JpegStream:
        self._thread.start()
        return self

    def __exit__(self, *_: object) -> None:
        self.cut()
        self._server.shutdown()
        self._server.server_close()

    @property
    def address(self) -> str:
        """What a camera node takes as ``source``."""
        return f'http://127.0.0.1:{self._server.server_port}/live.mjpg'

    @property
    def connections(self) -> int:
        """How many are served, or frozen."""
        return len(self._served)

    def cut(self) -> None:
        """End all connections; new ones are served."""
        self._generation += 1

    def freeze(self) -> None:
        """Keep the connections and send nothing on them any more."""
        self._frozen.set()

    def refuse(self) -> None:
        """Cut, and answer that there is nothing."""
        self._refusing.set()
        self.cut()

    def flow(self) -> None:
        """Neither frozen nor refused any more."""
        self._frozen.clear()
        self._refusing.clear()

    def _handler(self, parts: list[bytes], rate_hz: float) -> type[BaseHTTPRequestHandler]:
        stream = self

        class Handler(BaseHTTPRequestHandler):
            def do_GET(self) -> None:
                generation = stream._generation
                if stream._refusing.is_set():
                    self.send_error(404)
                    return
                self.send_response(200)
                self.send_header('Content-Type', 'multipart/x-mixed-replace; boundary=frame')
                self.end_headers()
                stream._served.add(self)
                try:
                    for part in itertools.cycle(parts):
                        if stream._generation != generation:
                            return
                        while stream._frozen.is_set() and stream._generation == generation:
                            if select.select([self.connection], [], [], POLL_S)[0]:  # the other side has hung up
                                return
                        self.wfile.write(part)
                        stream.sent += 1
                        time.sleep(1.0 / rate_hz)
                except OSError:
                    return
                finally:
                    stream._served.discard(self)

            def log_message(self, *_: Any) -> None:
                return

        return Handler
