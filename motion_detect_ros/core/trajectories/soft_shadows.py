"""What hardly differs from the ground that was there before: soft shadows, and what is smeared around an object.

They move as the object does, so no motion tells them from it; the ground shows through them. Hard shadows are as dark
as many vehicles and stay.
"""

from __future__ import annotations

from functools import cached_property

import cv2
import numpy as np

from motion_detect_ros.core.geometry.boxes import Box
from motion_detect_ros.core.trajectories.changes import earlier_half
from motion_detect_ros.core.trajectories.recent_frames import RecentFrames
from motion_detect_ros.core.types import BoolArray, FloatArray

#: Ratio of the grey values of soft shadows to those of the ground; added to both, grey levels: dark ones are noisy.
DARKEST, BRIGHTEST, BLACK_GRAY = 0.74, 1.05, 4.0
#: The ground is known where an object has gone its longer side and so many pixels since.
BEYOND_PX = 4.0
#: Pixels this close to the object are its own: what people draw, and the window of a point, reach a little beyond it.
MARGIN = np.ones((5, 5), np.uint8)
#: Less than this share of its pixels is no object.
LEAST_SHARE = 0.3


class SoftShadows:
    """Those in the current frame, which is compared with the oldest one, stabilised and in the light of now."""

    def __init__(self, frames: RecentFrames) -> None:
        """frames: as they are; what they show later is not looked at."""
        self._current, self._oldest = frames[0], frames[len(frames) - 1]
        self._seconds = frames.seconds(len(frames) - 1)

    def of(self, own: BoolArray, region: Box, speed_px_s: float, side_px: float) -> BoolArray:
        """(h, w) pixels of a region that are not the object but may be its shadow; none where that is not known.

        own: (h, w) what moves with the object; region: on the image; speed_px_s: against the background; side_px: the
        longer side; both in pixels of the working resolution.
        """
        if speed_px_s * self._seconds < side_px + BEYOND_PX:
            return np.zeros_like(own)
        rows, columns = np.arange(region.top, region.bottom) // 2, np.arange(region.left, region.right) // 2
        faint = self._faint[rows[:, None], columns]
        around = cv2.dilate((own & ~faint).view(np.uint8), MARGIN).view(np.bool_)
        shadow: BoolArray = faint & ~around
        return shadow if (own & ~shadow).sum() >= LEAST_SHARE * own.sum() else np.zeros_like(own)

    @cached_property
    def _faint(self) -> BoolArray:
        """(ceil(h / 2), ceil(w / 2)) where the ground shows through."""
        now, before = self._current.half, earlier_half(self._current, self._oldest)
        ratio: FloatArray = (now + np.float32(BLACK_GRAY)) / (before + np.float32(BLACK_GRAY))
        faint: BoolArray = (ratio > DARKEST) & (ratio < BRIGHTEST)
        return faint
