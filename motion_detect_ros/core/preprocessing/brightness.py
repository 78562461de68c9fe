"""Grey values as later stages expect them: of one brightness from frame to frame, of some contrast.

Trackers take jumps of the exposure for motion: lamps that flicker, a camera that adapts. And what counts as a change of
a pixel, in grey levels, is more in the pictures of a dull day, or of a night, than their things differ by.
"""

from __future__ import annotations

import math

import cv2
import numpy as np

from motion_detect_ros.core.forgetting import kept
from motion_detect_ros.core.geometry.robust import MAD_TO_SIGMA
from motion_detect_ros.core.types import NANOSECONDS, ByteArray, DoubleArray, FloatArray

#: Of every so many pixels along both axes one is looked at; frames are compared by the means of so many cells along
#: their width, at most.
STRIDE, CELLS = 4, 64
#: Grey values in the range of the first two are neither black nor bright; those from the last one on stay as they are.
DARKEST, BRIGHTEST, OVEREXPOSED = 12.0, 210.0, 250.0
#: The exposure has jumped where the logarithms of so many cells changed by at least this in the median, and by so many
#: standard errors of it; neighbours, of which so many count as one, err alike. Smaller changes trackers bear, and a
#: scene that comes closer looks like them.
MIN_CELLS, LEAST_JUMP, CERTAIN_ERRORS, ALIKE = 200, 0.08, 3.0, 8.0
#: Standard error of a median over that of a mean, of Gaussian errors.
MEDIAN_ERROR = math.sqrt(math.pi / 2.0)
#: These percentiles of the grey values are at least so far apart afterwards, by a factor of this at most. On the clips
#: that settings were made on they are 85 to 220 levels apart.
LOW_PERCENT, HIGH_PERCENT, LEAST_RANGE, MAX_STRETCH = 5.0, 95.0, 80.0, 3.0
#: A picture whose percentiles are closer than this, grey levels, shows nothing; one with so many times the contrast of
#: those before it is another one, and would turn black and white.
LEAST_CONTRAST, OTHER_CONTRAST = 4.0, 2.0
#: Time constant with which what was taken out of the exposure comes back, for the light has changed for good, and of
#: the percentiles, seconds.
MEMORY_S = 2.0
#: A longer gap than this starts anew, seconds.
MAX_GAP_S = 1.0

VALUES = np.arange(256.0)


class Brightness:
    """Looks grey values up in a table, which follows the exposure and the contrast of the frames."""

    def __init__(self) -> None:
        self.reset()

    def reset(self) -> None:
        """The exposure of the next frame is taken as it is."""
        self._earlier: list[FloatArray] = []  # cells of the last frame, and of the last one that was like one before it
        self._range: DoubleArray | None = None
        self._log_gain, self._stamp_ns = 0.0, 0

    def step(self, gray: ByteArray, stamp_ns: int) -> ByteArray:
        """The frame, (h, w), with other grey values; itself where they stay."""
        some = np.ascontiguousarray(gray[::STRIDE, ::STRIDE])
        height, width = some.shape
        size = (min(CELLS, width), max(1, min(height, round(CELLS * height / width))))
        cells = cv2.resize(some, size, interpolation=cv2.INTER_AREA).astype(np.float32)
        seconds = (stamp_ns - self._stamp_ns) / NANOSECONDS
        if any(each.shape != cells.shape for each in self._earlier) or not 0.0 < seconds <= MAX_GAP_S:
            self.reset()
            seconds = 0.0
        self._log_gain = kept(seconds, MEMORY_S) * self._log_gain + self._jump(cells)
        self._stamp_ns = stamp_ns
        table = _brightened(self._log_gain)
        table = np.rint(_stretched(table, self._followed_range(table, some, seconds)))
        return np.asarray(cv2.LUT(gray, table.astype(np.uint8)), np.uint8) if (table != VALUES).any() else gray

    def _jump(self, cells: FloatArray) -> float:
        """Of the exposure since the last frame that the new one is like: 0 for a damaged picture and after a cut."""
        for each in self._earlier:
            jump = _jump(cells, each)
            if jump is not None:
                self._earlier = [cells]
                return jump
        self._earlier = [cells, *self._earlier[-1:]]
        return 0.0

    def _followed_range(self, table: DoubleArray, some: ByteArray, seconds: float) -> DoubleArray:
        """(2,) percentiles of the grey values, by ``table``, over time; those of the frame if it shows far more."""
        below = np.bincount(some.ravel(), minlength=256).cumsum()
        now = table[np.searchsorted(below, below[-1] * np.array([LOW_PERCENT, HIGH_PERCENT]) / 100.0)]
        if now[1] - now[0] < LEAST_CONTRAST:
            return now if self._range is None else self._range
        if self._range is None:
            self._range = now
        far_more = (now[1] - now[0]) / (OTHER_CONTRAST * (self._range[1] - self._range[0]))
        self._range = self._range + (1.0 - kept(seconds, MEMORY_S)) / max(1.0, far_more) * (now - self._range)
        return now if far_more > 1.0 else self._range


def _jump(now: FloatArray, before: FloatArray) -> float | None:
    """Logarithm of the factor from cells ``now`` to those ``before``, 0 where the exposure did not jump.

    None where the pictures are not alike: their cells differ by no less than those of one of them among themselves.
    Over neighbouring frames of real clips, jerked by 8 px too, it is up to 1.0 times, after cuts and in damaged
    pictures from 1.2 times on.
    """
    usable = (np.minimum(now, before) > DARKEST) & (np.maximum(now, before) < BRIGHTEST)
    if np.count_nonzero(usable) < MIN_CELLS:
        return None
    here, there = np.log(now[usable]), np.log(before[usable])
    ratios = there - here
    typical, spread = _median_and_spread(ratios)
    if spread >= min(_median_and_spread(each)[1] for each in (here, there)):
        return None
    error = MEDIAN_ERROR * spread * math.sqrt(ALIKE / len(ratios))
    return typical if abs(typical) >= max(LEAST_JUMP, CERTAIN_ERRORS * error) else 0.0


def _median_and_spread(values: FloatArray) -> tuple[float, float]:
    """Median, and the deviation of Gaussian values of such a median distance to it."""
    typical = float(np.median(values))
    return typical, MAD_TO_SIGMA * float(np.median(np.abs(values - typical)))


def _brightened(log_gain: float) -> DoubleArray:
    """(256,) grey values times a factor; what is overexposed tells nothing and stays."""
    share = np.clip((OVEREXPOSED - VALUES) / (OVEREXPOSED - BRIGHTEST), 0.0, 1.0)
    values = np.clip(np.exp(share * log_gain) * VALUES, 0.0, 255.0)
    return np.asarray(np.maximum.accumulate(values), np.float64)


def _stretched(values: DoubleArray, low_high: DoubleArray) -> DoubleArray:
    """Grey values with at least ``LEAST_RANGE`` between two of them, the lower one where it was if there is room."""
    low, high = low_high.tolist()
    stretch = min(MAX_STRETCH, LEAST_RANGE / max(high - low, 1.0))
    if stretch <= 1.0:
        return values
    return np.asarray(np.clip(min(low, 255.0 - LEAST_RANGE) + stretch * (values - low), 0.0, 255.0), np.float64)
