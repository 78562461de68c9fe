"""Live capture: a thread takes pictures as they come, a bounded queue hands the newest ones over.

When the consumer is slower than the camera, the oldest waiting picture is dropped and counted: a detector that
avoids obstacles wants the newest picture, not every picture.
"""

from __future__ import annotations

import threading
from collections import deque
from collections.abc import Generator
from contextlib import closing
from dataclasses import dataclass
from time import monotonic
from types import TracebackType
from typing import Any, Self

from motion_detect_ros.core.errors import SourceError
from motion_detect_ros.core.frame_decimation import FrameDecimation
from motion_detect_ros.core.stamp_order import StampOrder, Verdict
from motion_detect_ros.core.types import NANOSECONDS, CameraModel
from motion_detect_ros.sources.address import is_address, path_of
from motion_detect_ros.sources.bags import BagFrames
from motion_detect_ros.sources.frames import FrameSource, SourceFrame
from motion_detect_ros.sources.live import LONGEST_CALL_S, LiveFrames
from motion_detect_ros.sources.opening import open_source
from motion_detect_ros.sources.secrets import masked

#: Pictures looked at for ``behind``, and the share of them that may be dropped before it is reported.
_BEHIND_WINDOW = 30
_BEHIND_SHARE = 0.1
#: Capture times kept for the rate.
_RATE_WINDOW = 60
#: Where the stamps of a file jump back, or ahead by more than this, it goes on at once, seconds: no stage bridges more
#: (``ego_motion.max_gap_s``). Only a rate that the user gives may be slower.
LONGEST_PAUSE_S = 60.0
#: A stopped thread has this long to come back from the driver, s: a little more than a call there may take.
_JOIN_TIMEOUT_S = LONGEST_CALL_S + 0.5


@dataclass(frozen=True)
class CaptureStats:
    """What happened since ``Capture.start``.

    ``captured``: pictures that came from the source; ``delivered``: handed to the reader; ``dropped``: thrown away
    because the reader was late (pictures left out by decimation are neither); ``capture_rate_hz``: of the
    source, over the last 60 pictures; ``behind``: over a tenth of the last 30 wanted pictures were dropped.
    """

    captured: int
    delivered: int
    dropped: int
    capture_rate_hz: float
    reconnects: int
    behind: bool


class Capture:
    """Pictures of a camera, stream, video file, image folder or bag; use as a context manager.

    source: camera number (``0``), address (``rtsp://``, ``http://``, ...) or a path that ``open_source`` takes,
    with or without ``file://``.
    fps: rate of a folder or video without stamps. decimation_keep, decimation_of: keep the first
    so many of every so many pictures (1 of N: every Nth; 2 of 5: pairs of neighbours for the flow, and time to process
    them). queue_size: pictures that may wait. realtime: files are played at the pace of their stamps and late pictures
    dropped; False waits for the reader instead and drops nothing. topic: image topic of a bag, needed where it has
    several.
    Raises: SourceError on a source that cannot be opened or a selection that makes no sense.
    """

    def __init__(
        self, source: str, fps: float | None = None, decimation_keep: int = 1,
        decimation_of: int = 1, queue_size: int = 2, realtime: bool = True, topic: str | None = None,
    ) -> None:
        if not source.strip():
            raise SourceError('source: expected a camera number, a path or an address, got nothing')
        if queue_size < 1 or not 1 <= decimation_keep <= decimation_of:
            raise SourceError(
                'capture: expected queue_size >= 1 and 1 <= decimation_keep <= decimation_of, got '
                f'queue_size={queue_size}, decimation_keep={decimation_keep}, decimation_of={decimation_of}')
        self._live = LiveFrames(source) if is_address(source) else None
        self._frames: FrameSource | LiveFrames = self._live or open_source(path_of(source), fps, topic)
        self._decimation = FrameDecimation(decimation_keep, decimation_of)
        self._queue_size = queue_size
        self._drops_when_late = realtime or self._live is not None
        self._paced = realtime and self._live is None
        self._longest_pause_s = max(LONGEST_PAUSE_S, 2.0 / fps if fps else 0.0)
        self._queue: deque[SourceFrame] = deque()
        self._changed = threading.Condition()
        self._captured = self._delivered = self._dropped = 0
        self._recent_drops: deque[bool] = deque(maxlen=_BEHIND_WINDOW)
        self._capture_times_s: deque[float] = deque(maxlen=_RATE_WINDOW)
        self._error: SourceError | None = None
        self._ended = False
        self._wanted = False
        self._stop = threading.Event()
        self._thread = threading.Thread(target=self._run, name='capture', daemon=True)

    def warm_up(self) -> None:
        """Throw pictures of a camera or stream away until ``start``: what waits in its driver would be old by then."""
        if self._live is not None:
            self._thread.start()

    def start(self) -> None:
        """Take pictures from now on."""
        with self._changed:
            self._wanted = True
        if self._thread.ident is None:
            self._thread.start()

    def __enter__(self) -> Self:
        self.start()
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None,
    ) -> None:
        self.close()

    def read(self, timeout_s: float) -> SourceFrame | None:
        """The oldest waiting picture; None at the end of a file, or where none comes within ``timeout_s``.

        ``ended`` tells the two apart. Raises: SourceError where reading failed for good.
        """
        with self._changed:
            self._changed.wait_for(lambda: self._queue or self._ended, timeout_s)
            if self._queue:
                self._delivered += 1
                frame = self._queue.popleft()
                self._changed.notify_all()
                return frame
            if self._error is not None:
                raise self._error
            return None

    @property
    def calibration(self) -> CameraModel | Any:
        """What the source brings along: a bag's sensor_msgs/CameraInfo as rosbags reads it, a KITTI drive's camera.

        None where it brings nothing, as cameras and streams.
        """
        frames = self._frames
        return frames.camera_info if isinstance(frames, BagFrames) else frames.camera

    @property
    def ended(self) -> bool:
        """True where no further picture will come."""
        with self._changed:
            return self._ended and not self._queue

    @property
    def stats(self) -> CaptureStats:
        """Counts and rates up to now."""
        with self._changed:
            times = self._capture_times_s
            span_s = times[-1] - times[0] if len(times) > 1 else 0.0
            dropped = sum(self._recent_drops)
            return CaptureStats(
                self._captured, self._delivered, self._dropped, (len(times) - 1) / span_s if span_s else 0.0,
                self._live.reconnects if self._live else 0, dropped > _BEHIND_SHARE * _BEHIND_WINDOW)

    @property
    def trouble(self) -> str:
        """Why a lost stream does not open again; empty where it runs, or nobody knows."""
        return self._live.trouble if self._live else ''

    @property
    def damage(self) -> str:
        """What of a file could not be read so far; empty where all could, and for streams."""
        frames = self._frames
        if isinstance(frames, LiveFrames):
            return ''
        return ', '.join(filter(None, (
            frames.damaged, f'{frames.bad_frames} unreadable pictures' if frames.bad_frames else '')))

    @property
    def blocked(self) -> bool:
        """After ``close``: the driver has not come back, the thread lets go of the device when it does."""
        return self._stop.is_set() and self._thread.is_alive()

    def close(self) -> None:
        """Stop the thread and let go of the device, in a bounded time; see ``blocked``."""
        self._stop.set()
        if self._live is not None:
            self._live.stop()
        with self._changed:
            self._changed.notify_all()
        if self._thread.is_alive():
            self._thread.join(_JOIN_TIMEOUT_S)
        elif self._live is not None:
            self._live.release()

    def _run(self) -> None:
        error = None
        try:
            with closing(self._paced_frames()) as frames:
                for frame in frames:
                    if self._stop.is_set():
                        break
                    self._offer(frame)
        except SourceError as problem:
            error = problem
        except Exception as problem:  # must not look like the end of the stream
            error = SourceError(masked(f'source: {type(problem).__name__}: {problem}'))
        finally:
            with self._changed:
                self._error, self._ended = error, True
                self._changed.notify_all()

    def _paced_frames(self) -> Generator[SourceFrame, None, None]:
        """The frames of the source; those of a file no earlier than their stamps allow, anew after each jump."""
        order, due_s = StampOrder(), monotonic()
        latest_ns: int | None = None
        for frame in self._frames:
            verdict = order.judge(frame.stamp_ns) if self._paced else Verdict.LATE
            if verdict.usable:
                pause_s = 0.0 if latest_ns is None else (frame.stamp_ns - latest_ns) / NANOSECONDS
                latest_ns = frame.stamp_ns
                due_s = due_s + pause_s if 0.0 <= pause_s <= self._longest_pause_s else monotonic()
                self._stop.wait(due_s - monotonic())
            yield frame

    def _offer(self, frame: SourceFrame) -> None:
        with self._changed:
            if not self._wanted:
                return
            wanted = self._decimation.keep_next()
            self._captured += 1
            self._capture_times_s.append(monotonic())
            if not wanted:
                return
            if not self._drops_when_late:
                self._changed.wait_for(lambda: len(self._queue) < self._queue_size or self._stop.is_set())
            late = len(self._queue) >= self._queue_size
            if late:
                self._queue.popleft()
                self._dropped += 1
            self._recent_drops.append(late)
            self._queue.append(frame)
            self._changed.notify_all()
