"""For how long of the last moments an object was detected: confirmation counts time, not frames."""

from __future__ import annotations

from collections import deque

#: What sums of frame periods may miss, seconds.
TIME_TOLERANCE_S = 1e-6
#: One detection alone is none, however long the frame's period.
MIN_DETECTIONS = 2
#: Frames that are remembered however long they take, and misses among them that say nothing yet: where frames are rare
#: or come in pairs (frame decimation), one miss is a long time.
MIN_FRAMES, FEW_MISSES = 6, 3


class DetectedTime:
    """The frames of the last ``window_s``, each with its period and whether the object was detected in it."""

    def __init__(self, window_s: float) -> None:
        self._window_s = window_s
        self._frames: deque[tuple[float, bool]] = deque()

    def add(self, dt_s: float, detected: bool) -> None:
        """The next frame; dt_s: since the one before, seconds. Frames that the window does not hold whole are left."""
        self._frames.append((dt_s, detected))
        while len(self._frames) > MIN_FRAMES and sum(self._periods()) > self._window_s + TIME_TOLERANCE_S:
            self._frames.popleft()

    def for_at_least(self, seconds: float) -> bool:
        """Whether the object was detected for so long, and in two frames at least."""
        times = self._periods(detected=True)
        return len(times) >= MIN_DETECTIONS and sum(times) >= seconds - TIME_TOLERANCE_S

    def missed_longer_than(self, seconds: float) -> bool:
        """Whether it was missed for longer, and in more than a few frames."""
        times = self._periods(detected=False)
        return len(times) > FEW_MISSES and sum(times) > seconds + TIME_TOLERANCE_S

    def _periods(self, detected: bool | None = None) -> list[float]:
        return [dt_s for dt_s, was in self._frames if detected is None or was is detected]
