"""Slow changes of the light between two stabilised pictures, at half of the working resolution."""

from __future__ import annotations

import cv2
import numpy as np

from motion_detect_ros.core.geometry.resizing import averaged
from motion_detect_ros.core.types import ByteArray

#: Light is estimated on halved images shrunk by this factor, where their smaller side has at least so many pixels.
LIGHT_SHRINK, LIGHT_SIDE_PX = 8, 40
#: Light is what changes over shrunk images under a median and a blur (window and deviation) of so many of their pixels;
#: by so many grey levels at most.
LIGHT_MEDIAN, LIGHT_BLUR, LIGHT_SIGMA, MAX_LIGHT_GRAY = 5, (5, 5), 1.5, 25.0


def shrunk(half: ByteArray) -> ByteArray:
    """(h, w) a halved image, shrunk by ``LIGHT_SHRINK``; a small one as it is."""
    height, width = half.shape
    if min(height, width) < LIGHT_SIDE_PX:
        return half
    columns, rows = width // LIGHT_SHRINK, height // LIGHT_SHRINK
    if (width % LIGHT_SHRINK == 0) == (height % LIGHT_SHRINK == 0):
        small: ByteArray = cv2.resize(half, (columns, rows), interpolation=cv2.INTER_AREA)
        return small
    return np.rint(averaged(half.astype(np.float32), rows, columns)).astype(np.uint8)


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
