"""What the objects of the last seconds show together that one alone does not."""

from __future__ import annotations

from collections import deque
from collections.abc import Sequence

import numpy as np
import numpy.typing as npt

from motion_detect_ros.core.types import NANOSECONDS, DoubleArray

#: So long objects are remembered, seconds.
MEMORY_S = 2.0


class RecentObjects:
    """Figures of the objects of the last seconds, of frames in which enough were seen together."""

    def __init__(self, least_objects: int) -> None:
        """least_objects: so many of one frame count; one that is seen again and again is no scene."""
        self._least = least_objects
        self.reset()

    def reset(self) -> None:
        """Another scene."""
        self._seen = deque[tuple[int, DoubleArray]]()

    def add(self, figures: Sequence[npt.ArrayLike], stamp_ns: int) -> None:
        """Of the objects of one frame, numbers or arrays of one shape; and its stamp."""
        if len(figures) >= self._least:
            self._seen.append((stamp_ns, np.array(figures, np.float64)))
        while self._seen and self._seen[0][0] < stamp_ns - MEMORY_S * NANOSECONDS:
            self._seen.popleft()

    def figures(self) -> DoubleArray | None:
        """(N, ...) of all that count; None where none does."""
        return np.concatenate([each for _, each in self._seen]) if self._seen else None
