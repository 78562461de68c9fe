"""The motion that the next frame is expected to show: that of the last one, where the last one went as expected."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from motion_detect_ros.core.ego_motion.point_tracking import Tracks, most_good
from motion_detect_ros.core.geometry.warp import apply
from motion_detect_ros.core.types import NANOSECONDS, DoubleArray, PreparedFrame

#: The last motion was as expected if no corner of the image was off by this, working pixels: half of what a tracker
#: corrects without a pyramid, as the next motion may be off by as much again.
AS_EXPECTED_PX = 1.5
#: Over a longer time than this, seconds, a camera may turn anywhere.
LONGEST_S = 0.06
#: The picture is where it was expected if its points are no less alike than in the last one by this factor, and grey
#: levels: on a ground that repeats itself all can be found at its neighbours.
LESS_ALIKE, NOISE_GRAY = 2.0, 1.0


@dataclass(frozen=True)
class _Seen:
    """``matrix``: (3, 3) motion into ``frame`` over ``nanoseconds``, full resolution; ``off_px``: how far from the
    expected one; ``error_gray``: median of its tracks.
    """

    frame: PreparedFrame
    matrix: DoubleArray
    nanoseconds: int
    off_px: float
    error_gray: float


class ExpectedMotion:
    """A camera that turns and flies evenly is where it is expected; one that is jerked is not."""

    def __init__(self) -> None:
        self._last: _Seen | None = None

    def between(self, previous: PreparedFrame, frame: PreparedFrame) -> DoubleArray | None:
        """(3, 3) motion expected from ``previous``, the frame of the last ``saw``, to ``frame``, full resolution.

        None where it is another frame, its own motion was not as expected, or they are over ``LONGEST_S`` apart.
        """
        if self._last is None or self._last.off_px >= AS_EXPECTED_PX:
            return None
        far = frame.stamp_ns - previous.stamp_ns > LONGEST_S * NANOSECONDS
        return None if far else self._foretold(previous, frame)

    @property
    def starts(self) -> bool:
        """Whether there is no last motion, or it had none right before it."""
        return self._last is None or math.isinf(self._last.off_px)

    def confirmed_by(self, tracks: Tracks) -> bool:
        """Whether points were found from where they were to be by the motion ``between`` returned."""
        return (self._last is not None and most_good(tracks)
                and _error_gray(tracks) <= LESS_ALIKE * self._last.error_gray + NOISE_GRAY)

    def saw(self, previous: PreparedFrame, frame: PreparedFrame, matrix: DoubleArray, tracks: Tracks) -> None:
        """matrix: (3, 3) the motion from one to the other, full resolution, which the tracks have told."""
        foretold = self._foretold(previous, frame)
        off_px = np.inf if foretold is None else frame.scale * _corner_distance(matrix, foretold, frame)
        self._last = _Seen(frame, matrix, frame.stamp_ns - previous.stamp_ns, off_px, _error_gray(tracks))

    def _foretold(self, previous: PreparedFrame, frame: PreparedFrame) -> DoubleArray | None:
        last = self._last
        if last is None or last.frame is not previous:
            return None
        share = (frame.stamp_ns - previous.stamp_ns) / last.nanoseconds
        foretold: DoubleArray = np.eye(3) + share * (last.matrix - np.eye(3))
        return foretold


def _error_gray(tracks: Tracks) -> float:
    """Median error of the good ones, of which there are some."""
    return float(np.median(tracks.error[tracks.good]))


def _corner_distance(one: DoubleArray, other: DoubleArray, frame: PreparedFrame) -> float:
    """Largest distance of what two warps make of a corner, full-resolution pixels."""
    corners = np.array([[x, y] for x in (0.0, frame.width) for y in (0.0, frame.height)], np.float32)
    return float(np.linalg.norm(apply(one, corners) - apply(other, corners), axis=1).max())
