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

import numpy as np

from motion_detect_ros.core.detection.image_pair import BESIDE_PX, ImagePair, mean_errors
from motion_detect_ros.core.geometry.boxes import Box
from motion_detect_ros.core.kernels import kernel
from motion_detect_ros.core.types import BoolArray, FloatArray

#: Window in which a change at the origin is searched, pixels.
SLACK_PX = 5


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
    flow = background_flow.reshape(1, 1, 2) if background_flow.ndim == 1 else background_flow
    around = Box(max(region.left - BESIDE_PX, window.left), max(region.top - BESIDE_PX, window.top),
                 min(region.right + BESIDE_PX, window.right), min(region.bottom + BESIDE_PX, window.bottom))
    foreground = np.zeros((region.height, region.width), np.bool_)
    gain, longest = np.empty(foreground.shape, np.float32), max(window.width, around.width)
    _compare(*pair.pictures, pair.back, window.left, window.top, around.left, around.top, region.left, region.top,
             flow, motion.reshape(1, 1, 2), np.float32(noise_gray ** 2),
             np.float32((noise_gray * threshold_sigma) ** 2), np.float32(threshold_sigma ** 2),
             np.empty((2, longest), np.float32), np.empty(longest, np.uint32), np.empty((4, longest), np.uint8),
             np.empty((3, longest), np.float32), np.empty((window.height, window.width), np.float32),
             np.empty((around.height, around.width), np.float32), foreground, gain)
    if pair.mask is not None:
        foreground &= pair.mask[region.top:region.bottom, region.left:region.right]
    return PhotometricTest(foreground, gain)


def reach_px(object_motion: FloatArray) -> int:
    """Largest distance of an object's pixels from their origins, with the slack of the test.

    object_motion: (2,) pixels over the pair, against the background.
    """
    return math.ceil(float(np.hypot(object_motion[0], object_motion[1]))) + SLACK_PX


@kernel()
def _compare(  # type: ignore[no-untyped-def]
    current, reference, back, window_left, window_top, around_left, around_top, left, top, flow, motion, noise, change,
    threshold, place, corner, corners, sums, still, moved, mask, gain,
):
    """``mask`` and ``gain`` of a region at left, top as ``_explained``; the boxes of ``still`` and ``moved`` are at
    window_left, window_top and at around_left, around_top. motion: (1, 1, 2); the rest as ``mean_errors``.
    """
    mean_errors(current, reference, back, window_left, window_top, flow, place, corner, corners, sums, still)
    mean_errors(current, reference, back, around_left, around_top, motion, place, corner, corners, sums, moved)
    _explained(still, left - window_left, top - window_top, moved, left - around_left, top - around_top, flow,
               motion[0, 0], noise, change, threshold, mask, gain)


@kernel(error_model='numpy')
def _explained(  # type: ignore[no-untyped-def]
    still, left, top, moved, moved_left, moved_top, flow, motion, noise, change, threshold, mask, gain,
):
    """``mask``: pixels of a box with a gain over ``threshold`` and a change at their origin; ``gain`` over ``noise``.

    still: (h, w) mean squared errors under the background flow, the box is at left, top of it; moved: under the
    object's motion; flow: (h, w, 2) or (1, 1, 2); change: value of the first from which the image changed; mask: False.
    """
    height, width = still.shape
    rows, columns = mask.shape
    for r in range(rows):
        first, second = still[top + r, left:left + columns], moved[moved_top + r, moved_left:moved_left + columns]
        gains = gain[r]
        for c in range(columns):
            gains[c] = (first[c] - second[c]) / noise
        for c in range(columns):
            if not gains[c] > threshold:
                continue
            behind = flow[min(top + r, flow.shape[0] - 1), min(left + c, flow.shape[1] - 1)]
            x = np.float32(left + c) - (motion[0] - behind[0])
            y = np.float32(top + r) - (motion[1] - behind[1])
            if -1.0 < x < width and -1.0 < y < height:
                mask[r, c] = _changed(still, int(np.rint(x)), int(np.rint(y)), change)


@kernel()
def _changed(errors, column, row, change):  # type: ignore[no-untyped-def]
    """Whether an error of (h, w) near a pixel is over ``change``; False beyond the border."""
    height, width = errors.shape
    slack = SLACK_PX // 2
    if not (0 <= column < width and 0 <= row < height):
        return False
    for r in range(max(0, row - slack), min(height, row + slack + 1)):
        for c in range(max(0, column - slack), min(width, column + slack + 1)):
            if errors[r, c] > change:
                return True
    return False
