"""Cameras and network streams, stamped when they arrive; a lost stream is opened again, later and later."""

from __future__ import annotations

import threading
import time
from collections.abc import Iterator

import cv2
import numpy as np

from motion_detect_ros.core.errors import SourceError
from motion_detect_ros.core.types import ByteArray
from motion_detect_ros.sources.address import camera_number
from motion_detect_ros.sources.frames import SourceFrame
from motion_detect_ros.sources.secrets import masked
from motion_detect_ros.sources.unreachable import TIMEOUT_S as REASON_TIMEOUT_S
from motion_detect_ros.sources.unreachable import why_unreachable
from motion_detect_ros.sources.video import open_capture

#: Waiting time before the first attempt to reconnect, and the most it doubles up to, s.
FIRST_BACK_OFF_S = 0.5
LONGEST_BACK_OFF_S = 10.0
#: A device or stream that does not open or gives no picture for so long is lost (OpenCV's own default for streams is
#: 30 s), ms: as a blocked call cannot be interrupted, this is also what stopping may take, see ``LONGEST_CALL_S``.
TIMEOUT_MS = 4000
#: OpenCV before 5 watches a stream for up to 9 s before it is open, the longer the fewer pictures come (10 Hz 3 s, 5 Hz
#: 6 s, 1 Hz 8 s); interrupted at that it says it is open, and gives no picture.
OPEN_TIMEOUT_MS = TIMEOUT_MS if int(cv2.__version__.split('.')[0]) >= 5 else 12_000
#: After ``stop``, until the thread that iterates comes back, s: it opens or reads, or asks why that failed.
LONGEST_CALL_S = max(TIMEOUT_MS / 1e3, 2 * REASON_TIMEOUT_S)
#: Addresses that may be those of recordings, by the names of containers.
_WEB = ('http://', 'https://')
_RECORDINGS = ('.mp4', '.m4v', '.mov', '.avi', '.mkv', '.webm')


class LiveFrames:
    """Frames of a camera (``0``) or address (``rtsp://...``), without end until ``stop``.

    The stamp is the system's time when the picture was taken from the driver, ns since 1970. ``trouble``: in a few
    words why a lost stream does not open again, where that is known.
    """

    camera = None

    def __init__(self, source: str) -> None:
        """Raises: SourceError where the first connection fails, with the reason where that is known."""
        self.source = source
        self.reconnects = 0
        self.trouble = ''
        self._stop = threading.Event()
        try:
            self._capture: cv2.VideoCapture | None = self._open()
        except SourceError as error:
            raise SourceError(': '.join(filter(None, (str(error), why_unreachable(source))))) from None
        self._refuse_recording(self._capture)

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
        number = camera_number(self.source)
        if number is None:
            return open_capture(self.source, TIMEOUT_MS, OPEN_TIMEOUT_MS)
        try:
            return open_capture(number, TIMEOUT_MS, OPEN_TIMEOUT_MS)
        except SourceError:  # by the name that was given, which may be that of its device
            raise SourceError(f'{self.source}: cannot be opened as a camera') from None

    def _refuse_recording(self, capture: cv2.VideoCapture) -> None:
        """A file on a web server comes as fast as it can, and again and again."""
        if not (self.source.startswith(_WEB) and self.source.partition('?')[0].lower().endswith(_RECORDINGS)):
            return
        frames = int(capture.get(cv2.CAP_PROP_FRAME_COUNT))  # live WebM has no length
        if frames > 0:
            self.release()
            raise SourceError(f'{masked(self.source)}: expected a live stream, got a recording of {frames} frames; '
                              'download it and give its path')

    def _read(self) -> ByteArray | None:
        if self._capture is None:
            return None
        ok, image = self._capture.read()
        return image.astype(np.uint8, copy=False) if ok else None

    def _reconnect(self) -> None:
        """Open again until it works or ``stop`` is called, waiting twice as long after every failure."""
        self.release()
        wait_s = back_off_s = FIRST_BACK_OFF_S
        while not self._stop.wait(wait_s):
            try:
                self._capture = self._open()
            except SourceError:
                if self._stop.is_set():
                    return
                asked_s = time.monotonic()
                self.trouble = why_unreachable(self.source)
                back_off_s = min(2 * back_off_s, LONGEST_BACK_OFF_S)
                wait_s = max(0.0, back_off_s - (time.monotonic() - asked_s))
                continue
            self.reconnects += 1
            self.trouble = ''
            return
