"""The one type of every dense flow method."""

from __future__ import annotations

from typing import Protocol

from motion_detect_ros.core.types import ByteArray, FloatArray


class FlowFunction(Protocol):
    """A method of dense optical flow between two images."""

    def __call__(self, current: ByteArray, reference: ByteArray, /) -> FloatArray:
        """(h, w, 2) float32 displacement current -> reference, pixels; NaN where the method gives none.

        current, reference: (h, w) uint8 of one size; ``reference[p + flow[p]]`` shows what ``current[p]`` shows.
        """
        ...
