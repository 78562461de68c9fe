"""Earlier frames at the working resolution of the current one, where that has changed (``load.adapt``)."""

from __future__ import annotations

from dataclasses import replace

import cv2
import numpy as np

from motion_detect_ros.core.types import ByteArray, PreparedFrame


def like(gray: ByteArray, shape: tuple[int, ...]) -> ByteArray:
    """(h, w) a grey image of another size as one of ``shape``, (h, w)."""
    if gray.shape == shape:
        return gray
    smaller = shape[0] < gray.shape[0]
    out: ByteArray = cv2.resize(
        gray, (shape[1], shape[0]), interpolation=cv2.INTER_AREA if smaller else cv2.INTER_LINEAR)
    return out


def at_resolution_of(earlier: PreparedFrame, frame: PreparedFrame) -> PreparedFrame:
    """``earlier``, of the same full resolution, at the working resolution of ``frame``."""
    if earlier.gray.shape == frame.gray.shape:
        return earlier
    mask = earlier.mask
    if mask is not None:
        mask = like(mask.view(np.uint8) * np.uint8(255), frame.gray.shape) == 255
    return replace(earlier, gray=like(earlier.gray, frame.gray.shape), scale=frame.scale, mask=mask)
