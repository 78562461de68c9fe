"""Does an object's own motion explain the image better than the background's motion? And where exactly?

Two hypotheses for every pixel of a candidate: it moved with the background, or with the object. Each predicts the
pixel from the earlier frame; the gain is the drop in squared error from the first to the second, in units of the
image noise, averaged over a small window. Leaked flow around an object and false flow on textureless ground gain
nothing.

Where the object has just left, plain background may be explained by its motion too (the ghost of every difference
image). A pixel of the object at p was at p - motion before, and there the image changed as well; for a ghost that
place lies behind the object, where nothing changed.
"""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np

from motion_detect_ros.core.boxes import Box
from motion_detect_ros.core.types import BoolArray, ByteArray, DoubleArray, FloatArray
from motion_detect_ros.core.warp import apply, inverse

#: Window over which errors are averaged, and slack in position of "the image changed there", pixels.
WINDOW_PX = 3
SLACK_PX = 5
#: Grey levels under which image noise is never taken to be (quantisation, compression).
MIN_NOISE_GRAY = 1.5


@dataclass(frozen=True)
class ImagePair:
    """Current and earlier grey image, (h, w) uint8 each, ``matrix`` (3, 3) earlier -> current, working pixels.

    ``mask``: (h, w) bool, pixels of the current image that show the scene; None = all.
    """

    current: ByteArray
    earlier: ByteArray
    matrix: DoubleArray
    mask: BoolArray | None = None

    def error(self, points: FloatArray, motion: FloatArray) -> FloatArray:
        """Grey-value error at ``points`` (h, w, 2) if they moved by ``motion`` on top of the ego-motion, pixels."""
        origin = apply(inverse(self.matrix), points - motion)
        difference: FloatArray = _sample(self.current, points) - _sample(self.earlier, origin)
        return difference


@dataclass(frozen=True)
class Support:
    """``mask``: (h, w) pixels that belong to the moving object; ``gain``: (h, w) what they are judged by."""

    mask: BoolArray
    gain: FloatArray


def support(
    pair: ImagePair, box: Box, background: FloatArray, motion: FloatArray, noise_gray: float, threshold_sigma: float,
) -> Support:
    """Which pixels of ``box`` the motion explains better than the background, by ``threshold_sigma`` noise levels.

    background, motion: (2,) or (h, w, 2), pixels over the pair, beyond the ego-motion; noise_gray: one deviation.
    """
    points = box.points()
    still = _windowed_square(pair.error(points, background))
    moved = _windowed_square(pair.error(points, motion))
    gain = (still - moved) / np.float32(noise_gray ** 2)
    changed = (still > (noise_gray * threshold_sigma) ** 2).astype(np.uint8)
    changed = cv2.dilate(changed, np.ones((SLACK_PX, SLACK_PX), np.uint8))
    corner = np.array([box.left, box.top], np.float32)
    source = points - (motion - background) - corner
    came_from_change = cv2.remap(changed, source.astype(np.float32), None, cv2.INTER_NEAREST,
                                 borderMode=cv2.BORDER_CONSTANT)
    mask = (gain > threshold_sigma ** 2) & (came_from_change > 0)
    if pair.mask is not None:
        mask &= pair.mask[box.top:box.bottom, box.left:box.right]
    return Support(mask, gain)


def image_noise(pair: ImagePair, points: FloatArray, background: FloatArray) -> float:
    """Deviation of the grey values that the background's motion leaves unexplained (median absolute, Gaussian scale).

    points: (n, m, 2) sample positions; background: (n, m, 2) motion beyond the ego-motion there, working pixels.
    """
    spread = float(np.median(np.abs(pair.error(points, background))))
    return max(MIN_NOISE_GRAY, 1.4826 * spread)


def _sample(image: ByteArray, points: FloatArray) -> FloatArray:
    values = cv2.remap(image, points, None, cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE)
    sampled: FloatArray = values.astype(np.float32)
    return sampled


def _windowed_square(error: FloatArray) -> FloatArray:
    mean: FloatArray = cv2.blur(error * error, (WINDOW_PX, WINDOW_PX))
    return mean
