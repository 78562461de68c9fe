"""Does an object's own motion explain the image better than the background's motion? And where exactly?

Two hypotheses for every pixel of a candidate: it moved with the background, or with the object. Each predicts the
pixel from the earlier frame; the gain is the drop in squared error from the first to the second, in units of the
image noise, summed over a small window. Leaked flow around an object and false flow on textureless ground gain
nothing; uncovered background is explained by neither.
"""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np

from motion_detect_ros.core.types import BoolArray, ByteArray, DoubleArray, FloatArray
from motion_detect_ros.core.warp import apply

#: Window over which the gain is averaged, pixels.
WINDOW_PX = 5
#: Grey levels under which image noise is never taken to be (quantisation, compression).
MIN_NOISE_GRAY = 1.5


@dataclass(frozen=True)
class Box:
    """Left, top, right, bottom in working-resolution pixels; right and bottom are exclusive."""

    left: int
    top: int
    right: int
    bottom: int

    def grown(self, margin: int, width: int, height: int) -> Box:
        """The box with ``margin`` on every side, cut to the image."""
        return Box(max(0, self.left - margin), max(0, self.top - margin),
                   min(width, self.right + margin), min(height, self.bottom + margin))


@dataclass(frozen=True)
class ImagePair:
    """Current and earlier grey image, (h, w) uint8 each, ``matrix`` (3, 3) earlier -> current, working pixels."""

    current: ByteArray
    earlier: ByteArray
    matrix: DoubleArray

    def error(self, box: Box, motion: FloatArray) -> FloatArray:
        """Grey-value error in ``box`` if its pixels moved by ``motion`` on top of the ego-motion.

        motion: (2,) or (h, w, 2), pixels. Returns (h, w) float32.
        """
        y, x = np.mgrid[box.top:box.bottom, box.left:box.right].astype(np.float32)
        points = np.stack([x, y], axis=-1)
        origin = apply(np.linalg.inv(self.matrix), points - motion)
        predicted = cv2.remap(self.earlier, origin, None, cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE)
        current = self.current[box.top:box.bottom, box.left:box.right]
        difference: FloatArray = current.astype(np.float32) - predicted.astype(np.float32)
        return difference


def gain_map(pair: ImagePair, box: Box, background: FloatArray, motion: FloatArray, noise_gray: float) -> FloatArray:
    """(h, w) float32: mean drop in squared error over the window, in units of the noise variance."""
    gain = pair.error(box, background) ** 2 - pair.error(box, motion) ** 2
    smooth: FloatArray = cv2.blur(gain, (WINDOW_PX, WINDOW_PX))
    return smooth / np.float32(noise_gray ** 2)


def image_noise(pair: ImagePair, points: FloatArray, background: FloatArray) -> float:
    """Deviation of the grey values that the background's motion leaves unexplained (median absolute, Gaussian scale).

    points: (n, m, 2) sample positions; background: (n, m, 2) motion beyond the ego-motion there, working pixels.
    """
    origin = apply(np.linalg.inv(pair.matrix), points - background)
    predicted = cv2.remap(pair.earlier, origin, None, cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE)
    seen = cv2.remap(pair.current, points, None, cv2.INTER_LINEAR)
    spread = float(np.median(np.abs(seen.astype(np.float32) - predicted.astype(np.float32))))
    return max(MIN_NOISE_GRAY, 1.4826 * spread)


def supported_box(supported: BoolArray, inside: BoolArray, min_pixels: int) -> tuple[Box | None, int]:
    """Bounds of the supported patches that touch the candidate, and how many pixels they have.

    supported, inside: (h, w); patches under ``min_pixels`` are noise. None where nothing is left.
    """
    count, patches, stats, _ = cv2.connectedComponentsWithStats(supported.astype(np.uint8), connectivity=8)
    touching = np.bincount(patches[inside], minlength=count) > 0
    keep = np.flatnonzero(touching & (stats[:, cv2.CC_STAT_AREA] >= min_pixels))
    keep = keep[keep > 0]
    if not len(keep):
        return None, 0
    left, top, width, height, area = stats[keep].T
    box = Box(int(left.min()), int(top.min()), int((left + width).max()), int((top + height).max()))
    return box, int(area.sum())
