"""Earlier frames at the working resolution of the current one, where that has changed (``load.adapt``)."""

from __future__ import annotations

from dataclasses import replace

import cv2
import numpy as np

from motion_detect_ros.core.types import ByteArray, FloatArray, PreparedFrame


def like(gray: ByteArray, shape: tuple[int, ...]) -> ByteArray:
    """(h, w) a grey image of another size as one of ``shape``, (h, w)."""
    if gray.shape == shape:
        return gray
    smaller = shape[0] < gray.shape[0]
    out: ByteArray = cv2.resize(
        gray, (shape[1], shape[0]), interpolation=cv2.INTER_AREA if smaller else cv2.INTER_LINEAR)
    return out


def averaged(values: FloatArray, rows: int, columns: int) -> FloatArray:
    """(rows, columns[, channels]) means of (h, w[, channels]) float32 over the cells of a coarser grid.

    A whole ratio along one axis only, with which OpenCV is slow, is taken first; the means are the same.
    """
    height, width = values.shape[:2]
    if (width % columns == 0) != (height % rows == 0):
        first = (width, rows) if width % columns else (columns, height)
        values = np.asarray(cv2.resize(values, first, interpolation=cv2.INTER_AREA), np.float32)
    return np.asarray(cv2.resize(values, (columns, rows), interpolation=cv2.INTER_AREA), np.float32)


def shrunk(gray: ByteArray, width_px: int) -> tuple[ByteArray, float]:
    """(h, w) a grey image at about this width, or as it is if that is smaller, and by how much it is: 1 over a whole
    number, which OpenCV averages ten times as fast as others.
    """
    factor = max(1, round(gray.shape[1] / width_px))
    height, width = (max(1, side // factor) for side in gray.shape)
    whole = gray[:height * factor, :width * factor]
    return np.asarray(cv2.resize(whole, (width, height), interpolation=cv2.INTER_AREA), np.uint8), 1.0 / factor


def at_resolution_of(earlier: PreparedFrame, frame: PreparedFrame) -> PreparedFrame:
    """``earlier``, of the same full resolution, at the working resolution of ``frame``."""
    if earlier.gray.shape == frame.gray.shape:
        return earlier
    mask = earlier.mask
    if mask is not None:
        mask = like(mask.view(np.uint8) * np.uint8(255), frame.gray.shape) == 255
    return replace(earlier, gray=like(earlier.gray, frame.gray.shape), scale=frame.scale, mask=mask)
