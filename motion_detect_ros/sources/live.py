"""Cameras and network streams, stamped when they arrive; a lost stream is opened again, later and later."""

from __future__ import annotations

import threading
import time
from collections.abc import Iterator

import cv2
import numpy as np

from motion_detect_ros.core.errors import SourceError
from motion_detect_ros.core.types import ByteArray
from motion_detect_ros.sources.frames import SourceFrame
from motion_detect_ros.sources.video import open_capture

#: Waiting time before the first attempt to reconnect, and the most it doubles up to, s.
FIRST_BACK_OFF_S = 0.5
LONGEST_BACK_OFF_S = 10.0
#: A device or stream that does not open or gives no picture for so long is lost (OpenCV's own default for streams is
#: 30 s), ms: as a blocked call cannot be interrupted, this is also what stopping may take.
TIMEOUT_MS = 4000


class LiveFrames:
    """Frames of a camera (``0``) or address (``rtsp://...``), without end until ``stop``.

    The stamp is the system's time when the picture was taken from the driver, ns since 1970.
    """

    camera = None

    def __init__(self, source: str) -> None:
        """Raises: SourceError where the first connection fails."""
        self.source = source
        self.reconnects = 0
        self._stop = threading.Event()
        self._capture: cv2.VideoCapture | None = self._open()

    def stop(self) -> None:
        """End the iteration at the next picture or attempt."""
        self._stop.set()

    def __iter__(self) -> Iterator[SourceFrame]:
        """Pictures as they come; the index counts pictures received."""
        index = 0
        try:
            while not self._stop.is_set():
                image = self._read()
                if image is None:
                    self._reconnect()
                    continue
                yield SourceFrame(index, image, time.time_ns())
                index += 1
        finally:
            self.release()

    def release(self) -> None:
        """Let go of the device; for the thread that iterates, or where none does."""
        if self._capture is not None:
            self._capture.release()
            self._capture = None

    def _open(self) -> cv2.VideoCapture:
        return open_capture(int(self.source) if self.source.isdigit() else self.source, TIMEOUT_MS)

    def _read(self) -> ByteArray | None:
        if self._capture is None:
            return None
        ok, image = self._capture.read()
        return image.astype(np.uint8, copy=False) if ok else None

    def _reconnect(self) -> None:
        """Open again until it works or ``stop`` is called, waiting twice as long after every failure."""
        self.release()
        wait_s = FIRST_BACK_OFF_S
        while not self._stop.wait(wait_s):
            try:
                self._capture = self._open()
            except SourceError:
                wait_s = min(2 * wait_s, LONGEST_BACK_OFF_S)
                continue
            self.reconnects += 1
            return
