"""When recorded messages are due, while the user changes the speed, pauses, or jumps."""

from __future__ import annotations

import threading
import time

from motion_detect_ros.core.types import NANOSECONDS


class Pace:
    """Maps the time of a recording to the steady clock; any thread may steer while another waits."""

    def __init__(self, rate: float) -> None:
        """rate: speed relative to the recording."""
        self._changed = threading.Condition()
        self._rate = rate
        self._paused = False
        self._interrupted = False
        self._anchor: tuple[int, int] | None = None  # steady time, time of the recording, ns

    @property
    def paused(self) -> bool:
        """Whether nothing is due."""
        return self._paused

    def begin(self, recorded_ns: int) -> None:
        """The recording is at this moment now."""
        with self._changed:
            self._interrupted = False
            self._anchor = time.monotonic_ns(), recorded_ns

    def steer(self, rate: float | None = None, paused: bool | None = None) -> None:
        """Go on from where the recording is, faster or slower, or not before further notice."""
        with self._changed:
            if self._anchor is not None:
                self._anchor = time.monotonic_ns(), self._position_ns()
            self._rate = self._rate if rate is None else rate
            self._paused = self._paused if paused is None else paused
            self._changed.notify_all()

    def interrupt(self) -> None:
        """``wait`` returns, and does so until ``begin``."""
        with self._changed:
            self._interrupted = True
            self._changed.notify_all()

    def wait(self, recorded_ns: int) -> float | None:
        """Returns when a message of this time is due: by how much it is late, seconds; None after ``interrupt``."""
        with self._changed:
            while not self._interrupted:
                early_ns = (recorded_ns - self._position_ns()) / self._rate
                if early_ns <= 0 and not self._paused:
                    return -early_ns / NANOSECONDS
                self._changed.wait(None if self._paused else early_ns / NANOSECONDS)
            return None

    def _position_ns(self) -> int:
        if self._anchor is None:
            return 0
        steady_ns, recorded_ns = self._anchor
        passed_ns = 0 if self._paused else time.monotonic_ns() - steady_ns
        return recorded_ns + round(passed_ns * self._rate)
