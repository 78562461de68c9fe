"""Appearance models, to recognise objects that are not detected by motion: they stopped, or flow fails on them."""

from __future__ import annotations

from collections.abc import Callable
from typing import Protocol

import cv2
import numpy as np

from motion_detect_ros.core.geometry.boxes import Box
from motion_detect_ros.core.types import ByteArray, DoubleArray, FloatArray

#: Search radius around the prediction, share of the object's sides and pixels.
REACH_SHARE, REACH_PX = 0.3, 4.0
#: Least standard deviation of the grey values, and least side, of an object that can be told from the ground.
MIN_SPREAD_GRAY, MIN_SIDE_PX = 4.0, 5
#: Least normalised cross-correlation with the template.
MIN_CORRELATION = 0.7
#: Bins of the histogram of grey values, ring around the box that it is compared with, share of its sides.
BINS, RING_SHARE = 32, 0.5
#: Least back-projected likelihood, share of that when learnt; least similarity of histograms (Bhattacharyya 1943).
MIN_LIKELIHOOD_SHARE, MIN_LIKENESS = 0.7, 0.85


class Appearance(Protocol):
    """The appearance of one object."""

    def find(self, gray: ByteArray, centre: DoubleArray, size: DoubleArray) -> DoubleArray | None:
        """(2,) centre of the object in ``gray`` near a box of ``centre`` and ``size``, None where it is not there.

        gray: (h, w) uint8; all in its pixels, edges of pixels at whole numbers.
        """


#: Appearance of a box (centre, size) of ``gray``, None where it is not distinctive.
Learn = Callable[[ByteArray, DoubleArray, DoubleArray], Appearance | None]


class Template:
    """The object's pixels, found by normalised cross-correlation (Lewis 1995)."""

    def __init__(self, pixels: ByteArray, size: DoubleArray, offset: DoubleArray) -> None:
        self._pixels = pixels
        self._size = size
        self._offset = offset

    @classmethod
    def learn(cls, gray: ByteArray, centre: DoubleArray, size: DoubleArray) -> Template | None:
        """See ``Learn``."""
        box = box_on(gray, centre, size)
        pixels = gray[box.top:box.bottom, box.left:box.right]
        if min(pixels.shape) < MIN_SIDE_PX or float(pixels.std()) < MIN_SPREAD_GRAY:
            return None
        middle = np.array([box.left + box.right, box.top + box.bottom]) / 2.0
        return cls(pixels.copy(), size.copy(), centre - middle)

    def find(self, gray: ByteArray, centre: DoubleArray, size: DoubleArray) -> DoubleArray | None:
        """See ``Appearance``."""
        scale = float(np.sqrt(size.prod() / self._size.prod()))
        height, width = (max(MIN_SIDE_PX, round(side * scale)) for side in self._pixels.shape)
        pixels = cv2.resize(self._pixels, (width, height), interpolation=cv2.INTER_LINEAR)
        sides = np.array([width, height])
        window = box_on(gray, centre - self._offset * scale, sides + 2.0 * (REACH_SHARE * size + REACH_PX))
        if window.width < width or window.height < height:
            return None
        likeness = cv2.matchTemplate(
            gray[window.top:window.bottom, window.left:window.right], pixels, cv2.TM_CCOEFF_NORMED)
        _, best, _, place = cv2.minMaxLoc(likeness)
        if not best >= MIN_CORRELATION:
            return None
        found: DoubleArray = np.array([window.left, window.top]) + place + sides / 2.0 + self._offset * scale
        return found


class GrayHistogram:
    """The object's grey values against those around it, found by CAMShift (Bradski 1998)."""

    def __init__(self, ratio: FloatArray, histogram: FloatArray, level: float) -> None:
        self._ratio = ratio
        self._histogram = histogram
        self._level = level

    @classmethod
    def learn(cls, gray: ByteArray, centre: DoubleArray, size: DoubleArray) -> GrayHistogram | None:
        """See ``Learn``."""
        inner, outer = box_on(gray, centre, size), box_on(gray, centre, size * (1.0 + 2.0 * RING_SHARE))
        if min(inner.width, inner.height) < MIN_SIDE_PX:
            return None
        own = _histogram(gray, inner)
        around = np.maximum(_histogram(gray, outer) * outer.area - own * inner.area, 0.0)
        ratio = own / np.maximum(own + around / max(1.0, float(around.sum())), 1e-6)
        level = float(own @ ratio)
        return cls(ratio.astype(np.float32), own, level) if level > 0.5 else None

    def find(self, gray: ByteArray, centre: DoubleArray, size: DoubleArray) -> DoubleArray | None:
        """See ``Appearance``."""
        window = box_on(gray, centre, size + 2.0 * (REACH_SHARE * size + REACH_PX))
        start = box_on(gray, centre, size).moved(-window.left, -window.top)
        if min(start.width, start.height) < MIN_SIDE_PX:
            return None
        seen = gray[window.top:window.bottom, window.left:window.right]
        likelihood = (255.0 * self._ratio[seen.astype(np.intp) * BINS // 256]).astype(np.uint8)
        stop = (cv2.TERM_CRITERIA_EPS | cv2.TERM_CRITERIA_COUNT, 10, 0.5)
        (middle, _, _), _ = cv2.CamShift(likelihood, (start.left, start.top, start.width, start.height), stop)
        found = np.array([window.left, window.top]) + np.array(middle) + 0.5
        if not np.isfinite(found).all():
            return None
        here = _histogram(gray, box_on(gray, found, size))
        alike = float(np.sqrt(here * self._histogram).sum()) >= MIN_LIKENESS
        return found if alike and float(here @ self._ratio) >= MIN_LIKELIHOOD_SHARE * self._level else None


#: What ``tracks.appearance`` may name.
APPEARANCE_MODELS: dict[str, Learn] = {'template': Template.learn, 'camshift': GrayHistogram.learn}


def box_on(gray: ByteArray, centre: DoubleArray, size: DoubleArray) -> Box:
    """The whole pixels of a box, cut to the image; empty where it is outside.

    gray: (h, w) uint8; centre, size: (2,) pixels of ``gray``, x before y.
    """
    height, width = gray.shape
    left, top = np.clip(np.rint(centre - size / 2.0), 0, [width, height]).astype(int)
    right, bottom = np.clip(np.rint(centre + size / 2.0), 0, [width, height]).astype(int)
    return Box(int(left), int(top), int(right), int(bottom))


def _histogram(gray: ByteArray, box: Box) -> FloatArray:
    """(BINS,) shares of the box's pixels; all zero for an empty box."""
    values = gray[box.top:box.bottom, box.left:box.right].ravel().astype(np.intp) * BINS // 256
    counts: FloatArray = (np.bincount(values, minlength=BINS) / max(1, values.size)).astype(np.float32)
    return counts
