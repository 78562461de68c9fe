"""Photometric test: which pixels does an object's motion explain better than the background flow?

Two hypotheses for every pixel of a candidate: it moved with the background, or with the object. Each predicts the
pixel from the reference frame. The likelihood gain is the squared error of the first less that of the second, over the
variance of the image noise, averaged over a small window. It is near zero for flow smeared around an object and for
false flow on textureless ground.

Uncovered background may fit the object's motion too (the ghost of every difference image). A pixel of the object at p
was at p - motion before, and there the image changed as well; for a ghost that place lies behind the object, where
nothing changed.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import cached_property

import cv2
import numpy as np

from motion_detect_ros.core.geometry.boxes import Box
from motion_detect_ros.core.geometry.robust import MAD_TO_SIGMA
from motion_detect_ros.core.geometry.warp import inverse
from motion_detect_ros.core.kernels import kernel
from motion_detect_ros.core.types import BoolArray, ByteArray, DoubleArray, FloatArray

#: Window over which errors are averaged, and window in which a change at the origin is searched, pixels.
WINDOW_PX = 3
SLACK_PX = 5
#: Least image noise, grey levels (quantisation, compression).
MIN_NOISE_GRAY = 1.5


@dataclass(frozen=True)
class ImagePair:
    """Current and reference grey image, (h, w) uint8 each, ``matrix`` (3, 3) reference -> current, working pixels.

    ``mask``: (h, w) bool, pixels of the current image that show the scene; None = all.
    """

    current: ByteArray
    reference: ByteArray
    matrix: DoubleArray
    mask: BoolArray | None = None

    @cached_property
    def back(self) -> FloatArray:
        """(3, 3) float32: current -> reference pixel."""
        return inverse(self.matrix).astype(np.float32)

    @cached_property
    def pictures(self) -> tuple[ByteArray, ByteArray]:
        """Current and reference, as one kind of array that a kernel is compiled for once."""
        return np.require(self.current, None, ['C', 'W']), np.require(self.reference, None, ['C', 'W'])


@dataclass(frozen=True)
class PhotometricTest:
    """``foreground``: (h, w) mask of the moving object; ``gain``: (h, w) likelihood gain."""

    foreground: BoolArray
    gain: FloatArray


def photometric_test(
    pair: ImagePair, region: Box, window: Box, background_flow: FloatArray, motion: FloatArray, noise_gray: float,
    threshold_sigma: float,
) -> PhotometricTest:
    """Which pixels of ``region`` the motion explains better than the background, by ``threshold_sigma`` noise levels.

    window: where errors are computed, ``region`` and the origins of its pixels around it (``reach_px``); pixels with an
    origin outside of it count as background. background_flow: (2,) or (h, w, 2) of ``window``, motion: (2,), both
    pixels over the pair, beyond the ego-motion; noise_gray: one deviation.
    """
    background = np.empty((window.height, window.width, 2), np.float32)
    background[...] = background_flow
    errors = np.empty_like(background)
    _squared_errors(*pair.pictures, pair.back, window.left, window.top, background, motion, errors)
    foreground = np.zeros((region.height, region.width), np.bool_)
    gain = np.empty(foreground.shape, np.float32)
    _explained(cv2.blur(errors, (WINDOW_PX, WINDOW_PX)), region.left - window.left, region.top - window.top,
               background, motion, np.float32(noise_gray ** 2), np.float32((noise_gray * threshold_sigma) ** 2),
               np.float32(threshold_sigma ** 2), foreground, gain)
    if pair.mask is not None:
        foreground &= pair.mask[region.top:region.bottom, region.left:region.right]
    return PhotometricTest(foreground, gain)


def reach_px(object_motion: FloatArray) -> int:
    """Largest distance of an object's pixels from their origins, with the slack of the test.

    object_motion: (2,) pixels over the pair, against the background.
    """
    return math.ceil(float(np.hypot(object_motion[0], object_motion[1]))) + SLACK_PX


def image_noise(pair: ImagePair, points: FloatArray, background: FloatArray) -> float:
    """Standard deviation of the grey-value error of the background flow (from the median absolute error).

    points: (n, m, 2) sample positions; background: (n, m, 2) motion beyond the ego-motion there, working pixels.
    """
    spread = _median_error(*pair.pictures, pair.back, points, background, np.zeros(256, np.int64))
    return max(MIN_NOISE_GRAY, MAD_TO_SIGMA * float(spread))


@kernel()
def _grey(image, x, y):  # type: ignore[no-untyped-def]
    """Grey value at a real position, linear, rounded; beyond the border, and for NaN, the border's."""
    height, width = image.shape
    x = min(x, np.float32(width - 1)) if x > 0.0 else np.float32(0.0)
    y = min(y, np.float32(height - 1)) if y > 0.0 else np.float32(0.0)
    left, top = int(x), int(y)
    right, bottom = min(left + 1, width - 1), min(top + 1, height - 1)
    u, v = x - np.float32(left), y - np.float32(top)
    a, b = np.float32(image[top, left]), np.float32(image[top, right])
    c, d = np.float32(image[bottom, left]), np.float32(image[bottom, right])
    above, below = a + u * (b - a), c + u * (d - c)
    return np.rint(above + v * (below - above))


@kernel(error_model='numpy')
def _grey_before(image, back, x, y):  # type: ignore[no-untyped-def]
    """Grey value of the reference image at what ``back`` makes of a current position."""
    depth = back[2, 0] * x + back[2, 1] * y + back[2, 2]
    return _grey(image, (back[0, 0] * x + back[0, 1] * y + back[0, 2]) / depth,
                 (back[1, 0] * x + back[1, 1] * y + back[1, 2]) / depth)


@kernel()
def _squared_errors(  # type: ignore[no-untyped-def]
    current, reference, back, left, top, background_flow, motion, errors,
):
    """``errors``: (h, w, 2) squared ones of the grey values of a box under background flow and under the motion."""
    height, width = background_flow.shape[:2]
    for r in range(height):
        y = np.float32(top + r)
        for c in range(width):
            x, here = np.float32(left + c), np.float32(current[top + r, left + c])
            miss = here - _grey_before(reference, back, x - background_flow[r, c, 0], y - background_flow[r, c, 1])
            errors[r, c, 0] = miss * miss
            miss = here - _grey_before(reference, back, x - motion[0], y - motion[1])
            errors[r, c, 1] = miss * miss


@kernel(error_model='numpy')
def _explained(  # type: ignore[no-untyped-def]
    errors, left, top, background_flow, motion, noise, change, threshold, mask, gain,
):
    """``mask``: pixels of a box at left, top of ``errors`` with a gain over ``threshold`` and a change at their origin.

    errors: (h, w, 2) mean squared errors; change: value of the first from which the image changed; mask: False;
    gain: in units of ``noise``.
    """
    height, width = errors.shape[:2]
    rows, columns = mask.shape
    slack, motion_x, motion_y = SLACK_PX // 2, motion[0], motion[1]
    for r in range(rows):
        for c in range(columns):
            gain[r, c] = (errors[top + r, left + c, 0] - errors[top + r, left + c, 1]) / noise
    for r in range(rows):
        for c in range(columns):
            if not gain[r, c] > threshold:
                continue
            x = np.float32(left + c) - (motion_x - background_flow[top + r, left + c, 0])
            y = np.float32(top + r) - (motion_y - background_flow[top + r, left + c, 1])
            if not (-1.0 < x < width and -1.0 < y < height):
                continue
            column, row = int(np.rint(x)), int(np.rint(y))
            if not (0 <= column < width and 0 <= row < height):
                continue
            for near_r in range(max(0, row - slack), min(height, row + slack + 1)):
                for near_c in range(max(0, column - slack), min(width, column + slack + 1)):
                    mask[r, c] |= errors[near_r, near_c, 0] > change


@kernel()
def _median_error(current, reference, back, points, background_flow, counts):  # type: ignore[no-untyped-def]
    """Median grey-value error at ``points`` (n, m, 2) under background flow; by counting, as errors are integers.

    counts: (256,) zeros.
    """
    for r in range(points.shape[0]):
        for c in range(points.shape[1]):
            x, y = points[r, c, 0], points[r, c, 1]
            before = _grey_before(reference, back, x - background_flow[r, c, 0], y - background_flow[r, c, 1])
            counts[int(abs(_grey(current, x, y) - before))] += 1
    total = points.shape[0] * points.shape[1]
    low = high = passed = 0
    while passed <= total // 2 and high < len(counts):
        if passed <= (total - 1) // 2:
            low = high
        passed += counts[high]
        high += 1
    return (low + high - 1) / 2.0
