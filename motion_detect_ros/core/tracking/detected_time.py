"""Detected time of an object within a window: confirmation counts seconds, not frames."""

from __future__ import annotations

from collections import deque

#: Share of a frame's period that sums of periods may miss, for jitter. Beyond that times round up to whole frames:
#: two frames of 20 Hz are not 0.12 s, and two chance candidates in a row must not confirm each other.
TOLERANCE = 0.25
#: A single detection never confirms, however long the frame's period.
MIN_DETECTIONS = 2
#: Least number of frames kept, and number of misses that are tolerated, whatever their duration: at a low frame rate,
#: or with frames in pairs (frame decimation), one miss is a long time.
MIN_FRAMES, FEW_MISSES = 6, 3


class DetectedTime:
    """The frames of the last ``window_s`` seconds, each with its period and whether the object was detected."""

    def __init__(self, window_s: float) -> None:
        self._window_s = window_s
        self._frames: deque[tuple[float, bool]] = deque()

    def add(self, dt_s: float, detected: bool) -> None:
        """Add a frame; dt_s: since the one before, seconds. Frames that do not fit the window are removed."""
        self._frames.append((dt_s, detected))
        while len(self._frames) > MIN_FRAMES and sum(self._periods()) > self._window_s + TOLERANCE * dt_s:
            self._frames.popleft()

    def for_at_least(self, seconds: float) -> bool:
        """Whether the object was detected for ``seconds``, and in two frames at least."""
        times = self._periods(detected=True)
        return len(times) >= MIN_DETECTIONS and sum(times) >= seconds - TOLERANCE * times[-1]

    def missed_longer_than(self, seconds: float) -> bool:
        """Whether it was missed for longer than ``seconds``, and in more than a few frames."""
        times = self._periods(detected=False)
        return len(times) > FEW_MISSES and sum(times) > seconds + TOLERANCE * times[-1]

    def _periods(self, detected: bool | None = None) -> list[float]:
        return [dt_s for dt_s, was in self._frames if detected is None or was is detected]
