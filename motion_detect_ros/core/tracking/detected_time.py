"""For how long of the last moments an object was detected: confirmation counts time, not frames."""

from __future__ import annotations

from collections import deque

#: What sums of frame periods may miss, seconds.
TIME_TOLERANCE_S = 1e-6
#: One detection alone is none, however long the frame's period.
MIN_DETECTIONS = 2


class DetectedTime:
    """The frames of the last ``window_s``, each with its period and whether the object was detected in it."""

    def __init__(self, window_s: float) -> None:
        self._window_s = window_s
        self._frames: deque[tuple[float, bool]] = deque()

    def add(self, dt_s: float, detected: bool) -> None:
        """The next frame; dt_s: since the one before, seconds. Frames that the window does not hold whole are left."""
        self._frames.append((dt_s, detected))
        while len(self._frames) > MIN_DETECTIONS and self._total_s > self._window_s + TIME_TOLERANCE_S:
            self._frames.popleft()

    def for_at_least(self, seconds: float) -> bool:
        """Whether the object was detected for so long, and in two frames at least."""
        times = [dt_s for dt_s, detected in self._frames if detected]
        return len(times) >= MIN_DETECTIONS and sum(times) >= seconds - TIME_TOLERANCE_S

    @property
    def missed_s(self) -> float:
        """Time of the window in which it was not detected, seconds."""
        return sum(dt_s for dt_s, detected in self._frames if not detected)

    @property
    def _total_s(self) -> float:
        return sum(dt_s for dt_s, _ in self._frames)
