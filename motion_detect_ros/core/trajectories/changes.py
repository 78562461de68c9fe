"""What the current frame shows differently from stabilised earlier ones, apart from slow changes of the light.

At half of the working resolution.
"""

from __future__ import annotations

import cv2
import numpy as np

from motion_detect_ros.core.trajectories.recent_frames import RecentFrames
from motion_detect_ros.core.types import BoolArray, ByteArray

#: What a moving object covers differs from what was there so long ago, seconds.
COVERED_S = (0.5, 1.0)
#: Changed: the mean difference of this window is over so many grey levels.
WINDOW, CHANGED_GRAY = (3, 3), 8


def long_ago(frames: RecentFrames) -> list[int]:
    """Numbers of the frames closest to ``COVERED_S`` ago."""
    return sorted({frames.nearest(seconds) for seconds in COVERED_S})


def changed_pixels(frames: RecentFrames, frames_ago: list[int]) -> BoolArray:
    """(ceil(h / 2), ceil(w / 2)) where the current frame differs from all of the earlier ones.

    Each of them is brought to its place and to its light. False everywhere without any.
    """
    current = frames[0].half
    least: ByteArray = np.full(current.shape, 255 if frames_ago else 0, np.uint8)
    for ago in frames_ago:
        least = cv2.min(least, cv2.absdiff(current, frames.earlier_half(ago)))
    changed: BoolArray = cv2.blur(least, WINDOW) > CHANGED_GRAY
    return changed
