"""What the current frame shows differently from stabilised earlier ones, apart from slow changes of the light.

At half of the working resolution.
"""

from __future__ import annotations

import cv2
import numpy as np

from motion_detect_ros.core.geometry.warp import at_scale, stabilise
from motion_detect_ros.core.trajectories.recent_frames import LIGHT_SIDE_PX, RecentFrame, RecentFrames, shrunk
from motion_detect_ros.core.types import BoolArray, ByteArray

#: Light is what changes over shrunk images under a median and a blur (window and deviation) of so many of their pixels;
#: by so many grey levels at most.
LIGHT_MEDIAN, LIGHT_BLUR, LIGHT_SIGMA, MAX_LIGHT_GRAY = 5, (5, 5), 1.5, 25.0
#: Changed: the mean difference of this window is over so many grey levels.
WINDOW, CHANGED_GRAY = (3, 3), 8


def changed_pixels(frames: RecentFrames, frames_ago: list[int]) -> BoolArray:
    """(ceil(h / 2), ceil(w / 2)) where the current frame differs from all of the earlier ones.

    Each of them is brought to its place and to its light. False everywhere without any.
    """
    current = frames[0].half
    least: ByteArray = np.full(current.shape, 255 if frames_ago else 0, np.uint8)
    for ago in frames_ago:
        least = cv2.min(least, cv2.absdiff(current, earlier_half(frames[0], frames[ago])))
    changed: BoolArray = cv2.blur(least, WINDOW) > CHANGED_GRAY
    return changed


def earlier_half(current: RecentFrame, earlier: RecentFrame) -> ByteArray:
    """(ceil(h / 2), ceil(w / 2)) the earlier frame at half its size, in the place and the light of the current one."""
    return relit(stabilise(earlier.half, at_scale(earlier.matrix, 0.5)), current.shrunk)


def relit(earlier: ByteArray, current: ByteArray) -> ByteArray:
    """(h, w) the earlier halved image in the light of the current one, which is ``shrunk``, where the light changed
    slowly from place to place.
    """
    height, width = earlier.shape
    if min(height, width) < LIGHT_SIDE_PX:
        return earlier
    difference = cv2.subtract(current, shrunk(earlier), dtype=cv2.CV_32F)
    light = cv2.GaussianBlur(cv2.medianBlur(difference, LIGHT_MEDIAN), LIGHT_BLUR, LIGHT_SIGMA)
    light = cv2.resize(np.clip(light, -MAX_LIGHT_GRAY, MAX_LIGHT_GRAY), (width, height))
    out: ByteArray = cv2.add(earlier, light, dtype=cv2.CV_8U)
    return out
