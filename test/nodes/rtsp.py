"""Real RTSP servers for tests, each in a process of its own."""

from __future__ import annotations

import signal
import socket
import subprocess
from pathlib import Path

import numpy as np
from peers import TIMEOUT_S, picture

#: GStreamer's Python bindings belong to the system's Python.
PYTHON = Path('/usr/bin/python3')
SERVER = Path(__file__).with_name('rtsp_server.py')
NEEDS = ('import gi; gi.require_version("Gst", "1.0"); gi.require_version("GstRtspServer", "1.0"); '
         'from gi.repository import Gst, GstRtspServer; Gst.init(None); '
         'assert all(Gst.ElementFactory.find(n) for n in ("jpegdec", "x264enc", "rtph264pay"))')
PACKAGES = 'gir1.2-gst-rtsp-server-1.0 python3-gi gstreamer1.0-plugins-good gstreamer1.0-plugins-ugly'
FPS = 10
#: The number of a picture stands in its top and its bottom rows, as a decoder that has not got all of a picture leaves
#: rows of the one before: so many bits and their complements, black and white blocks of so many pixels.
BITS, BLOCK_PX = 10, 16


def serves() -> bool:
    """Whether this machine can be an RTSP server."""
    return PYTHON.exists() and subprocess.run(
        [PYTHON, '-c', NEEDS], capture_output=True, check=False, timeout=60).returncode == 0


class RtspServer:
    """Starts, stops and freezes servers of one folder of pictures on one port of the loopback device."""

    def __init__(self, folder: Path) -> None:
        self.folder = folder
        with socket.socket() as one:
            one.bind(('127.0.0.1', 0))
            self._port = int(one.getsockname()[1])
        self._running: list[subprocess.Popen[str]] = []

    @property
    def address(self) -> str:
        """Of the stream."""
        return f'rtsp://127.0.0.1:{self._port}/drone'

    def start(self, folder: Path | None = None, fps: int = FPS, credentials: str = '') -> None:
        """Returns when it can be asked."""
        command = [PYTHON, SERVER, folder or self.folder, str(self._port), str(fps)] + [credentials] * bool(credentials)
        process = subprocess.Popen(command, stdout=subprocess.PIPE, text=True)
        self._running.append(process)
        assert process.stdout is not None
        assert process.stdout.readline() == 'ready\n'

    def send(self, number: signal.Signals) -> None:
        """A signal to the one that runs."""
        self._running[-1].send_signal(number)

    def kill(self) -> None:
        """As a loss of power, but that the connections are closed."""
        self._running[-1].kill()
        self._running[-1].wait(TIMEOUT_S)

    def close(self) -> None:
        """End them all."""
        for process in self._running:
            process.kill()
            process.wait(TIMEOUT_S)


def numbered(index: int, scale: int = 1) -> np.ndarray:
    """``picture(index % 40)`` with its number in it, so many times as large."""
    image = picture(index % 40)
    bits = [index >> bit & 1 for bit in range(BITS)]
    for place, bit in enumerate([*bits, *(1 - bit for bit in bits)]):
        for rows in (slice(BLOCK_PX), slice(-BLOCK_PX, None)):
            image[rows, place * BLOCK_PX:(place + 1) * BLOCK_PX] = 255 * bit
    return image.repeat(scale, axis=0).repeat(scale, axis=1)


def number_of(image: np.ndarray) -> int | None:
    """The number of a picture; None where a decoder that had not got everything drew it."""
    scale = image.shape[0] // picture(0).shape[0]
    image = image[scale // 2::scale, scale // 2::scale]
    top, bottom = _number_in(image[:BLOCK_PX]), _number_in(image[-BLOCK_PX:])
    return top if top == bottom else None


def _number_in(rows: np.ndarray) -> int | None:
    """The number that rows of a picture say, if they say one."""
    blocks = rows[4:-4, :2 * BITS * BLOCK_PX].reshape(BLOCK_PX - 8, 2 * BITS, BLOCK_PX, -1)
    bits = blocks[:, :, 4:-4].mean(axis=(0, 2, 3)) > 127
    if (bits[:BITS] == bits[BITS:]).any():
        return None
    return sum(1 << place for place, bit in enumerate(bits[:BITS]) if bit)
