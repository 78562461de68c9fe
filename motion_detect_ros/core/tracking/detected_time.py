"""Detected time of an object within a window: confirmation counts seconds, not frames."""

from __future__ import annotations

from collections import deque
from itertools import compress

from motion_detect_ros.core.periods import exceeded, reached

#: A single detection never confirms, however long the frame's period, nor does one that is carried on.
MIN_DETECTIONS = 2
#: Least number of frames kept, and number of misses that are tolerated, whatever their duration: at a low frame rate,
#: or with frames in pairs (frame decimation), one miss is a long time.
MIN_FRAMES, FEW_MISSES = 6, 3


class DetectedTime:
    """The last frames, each with its period and how the object was detected."""

    def __init__(self, dt_s: float, measured: bool) -> None:
        """First detected in a frame with a period of ``dt_s``; measured: see ``Candidate``."""
        self._periods, self._detected, self._measured = deque([dt_s]), deque([True]), deque([measured])

    def add(self, dt_s: float, window_s: float, detected: bool, measured: bool = True) -> None:
        """Add a frame; dt_s: since the one before, seconds; measured: see ``Candidate``.

        Frames that do not fit the last ``window_s`` seconds are removed.
        """
        self._periods.append(dt_s)
        self._detected.append(detected)
        self._measured.append(detected and measured)
        while len(self._periods) > MIN_FRAMES and exceeded(sum(self._periods), window_s, dt_s):
            for each in (self._periods, self._detected, self._measured):
                each.popleft()

    def for_at_least(self, seconds: float) -> bool:
        """Whether the object was detected for ``seconds``, and measured in two frames at least."""
        if sum(self._measured) < MIN_DETECTIONS:
            return False
        times = list(compress(self._periods, self._detected))
        return reached(sum(times), seconds, times[-1])

    def missed_longer_than(self, seconds: float) -> bool:
        """Whether it was missed for longer than ``seconds``, and in more than a few frames."""
        times = [dt_s for dt_s, detected in zip(self._periods, self._detected, strict=True) if not detected]
        return len(times) > FEW_MISSES and exceeded(sum(times), seconds, times[-1])
