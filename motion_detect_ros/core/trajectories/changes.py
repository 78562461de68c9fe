"""What the current frame shows differently from stabilised earlier ones, apart from slow changes of the light."""

from __future__ import annotations

import cv2
import numpy as np
import numpy.typing as npt

from motion_detect_ros.core.geometry.warp import stabilise
from motion_detect_ros.core.trajectories.recent_frames import RecentFrames
from motion_detect_ros.core.types import BoolArray, ByteArray, FloatArray

#: Light is what changes over images shrunk by this factor, under a median and a blur (window and deviation) of so many
#: of their pixels; by so many grey levels at most.
LIGHT_SHRINK, LIGHT_MEDIAN, LIGHT_BLUR, LIGHT_SIGMA, MAX_LIGHT_GRAY = 16, 5, (5, 5), 1.5, 25.0
#: Smallest image, pixels, that the light is estimated on.
MIN_SIDE_PX = LIGHT_SHRINK * LIGHT_MEDIAN
#: Changed: mean difference of 3 x 3 pixels over this, grey levels.
WINDOW_PX, CHANGED_GRAY = 3, 8.0


def changed_pixels(frames: RecentFrames, frames_ago: list[int]) -> BoolArray:
    """(h, w) where the current frame differs from all of the earlier ones, each brought to its place and its light."""
    least: ByteArray | None = None
    for ago in frames_ago:
        earlier = stabilise(frames[ago].gray, frames[ago].matrix)
        difference = cv2.absdiff(frames[0].gray, relit(earlier, frames[0].gray))
        least = difference if least is None else np.minimum(least, difference)
    if least is None:
        return np.zeros(frames[0].gray.shape, np.bool_)
    changed: BoolArray = cv2.blur(least, (WINDOW_PX, WINDOW_PX)) > CHANGED_GRAY
    return changed


def relit(earlier: ByteArray, current: ByteArray) -> ByteArray:
    """(h, w) the earlier image in the light of the current one, where it changed slowly from place to place."""
    height, width = current.shape
    if min(height, width) < MIN_SIDE_PX:
        return earlier
    small = (width // LIGHT_SHRINK, height // LIGHT_SHRINK)
    brighter = cv2.subtract(_shrunk(current, small), _shrunk(earlier, small), dtype=cv2.CV_32F)
    light = cv2.GaussianBlur(cv2.medianBlur(brighter, LIGHT_MEDIAN), LIGHT_BLUR, LIGHT_SIGMA)
    light = cv2.resize(np.clip(light, -MAX_LIGHT_GRAY, MAX_LIGHT_GRAY), (width, height))
    out: ByteArray = cv2.add(earlier, light, dtype=cv2.CV_8U)
    return out


def _shrunk(image: ByteArray, size: tuple[int, int]) -> FloatArray | npt.NDArray[np.uint8]:
    return cv2.resize(image, size, interpolation=cv2.INTER_AREA)
