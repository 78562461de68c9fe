"""What the current frame shows differently from stabilised earlier ones, apart from slow changes of the light.

At half of the working resolution.
"""

from __future__ import annotations

import cv2
import numpy as np

from motion_detect_ros.core.geometry.warp import at_scale, stabilise
from motion_detect_ros.core.trajectories.recent_frames import RecentFrame, RecentFrames
from motion_detect_ros.core.types import BoolArray, ByteArray

#: Light is what changes over halved images shrunk by this factor, under a median and a blur (window and deviation) of
#: so many of their pixels; by so many grey levels at most.
LIGHT_SHRINK, LIGHT_MEDIAN, LIGHT_BLUR, LIGHT_SIGMA, MAX_LIGHT_GRAY = 8, 5, (5, 5), 1.5, 25.0
#: Smallest side of a halved image, pixels, that the light is estimated on.
MIN_SIDE_PX = LIGHT_SHRINK * LIGHT_MEDIAN
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
    return relit(stabilise(earlier.half, at_scale(earlier.matrix, 0.5)), current.half)


def relit(earlier: ByteArray, current: ByteArray) -> ByteArray:
    """(h, w) the earlier image in the light of the current one, where it changed slowly from place to place."""
    height, width = current.shape
    if min(height, width) < MIN_SIDE_PX:
        return earlier
    small = (width // LIGHT_SHRINK, height // LIGHT_SHRINK)
    one, other = (cv2.resize(image, small, interpolation=cv2.INTER_AREA) for image in (current, earlier))
    light = cv2.GaussianBlur(cv2.medianBlur(cv2.subtract(one, other, dtype=cv2.CV_32F), LIGHT_MEDIAN), LIGHT_BLUR,
                             LIGHT_SIGMA)
    light = cv2.resize(np.clip(light, -MAX_LIGHT_GRAY, MAX_LIGHT_GRAY), (width, height))
    out: ByteArray = cv2.add(earlier, light, dtype=cv2.CV_8U)
    return out
