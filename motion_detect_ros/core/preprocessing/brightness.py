"""Grey values as later stages expect them: of one brightness from frame to frame, of some contrast.

Trackers take jumps of the exposure for motion: lamps that flicker, a camera that adapts. And what counts as a change of
a pixel, in grey levels, is more in the pictures of a dull day, or of a night, than their things differ by.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import cv2
import numpy as np

from motion_detect_ros.core.forgetting import kept
from motion_detect_ros.core.geometry.robust import MAD_TO_SIGMA
from motion_detect_ros.core.preprocessing.scene_mask import whole_cells
from motion_detect_ros.core.types import NANOSECONDS, BoolArray, ByteArray, DoubleArray, FloatArray

#: Of every so many pixels along both axes one is looked at; frames are compared by the means of so many cells along
#: their width, at most.
STRIDE, CELLS = 4, 64
#: Grey values in the range of the first two are neither black nor bright; those from the last one on are white.
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
#: A picture whose percentiles are closer than this, grey levels, shows nothing; one with over so many times the
#: contrast of those before it, which would turn black and white, is stretched like one with its own over this number.
LEAST_CONTRAST, OTHER_CONTRAST = 4.0, 2.0
#: Time constant with which what was taken out of the exposure comes back, for the light has changed for good, and of
#: the percentiles, seconds.
MEMORY_S = 2.0
#: A longer gap than this starts anew, seconds.
MAX_GAP_S = 1.0

VALUES = np.arange(256.0)


@dataclass(frozen=True)
class _Seen:
    """An earlier frame: its ``cells``; ``level`` of the exposure, and ``log_gain``, what was added to it, logs."""

    cells: FloatArray
    level: float
    log_gain: float
    stamp_ns: int


class Brightness:
    """Looks grey values up in a table, which follows the exposure and the contrast of the frames."""

    def __init__(self) -> None:
        self.reset()

    def reset(self) -> None:
        """The exposure of the next frame is taken as it is."""
        self._earlier: list[_Seen] = []  # the last frame, and the last one that was like one before it
        self._usual_level = 0.0
        self._range: DoubleArray | None = None
        self._stamp_ns = 0

    def step(self, gray: ByteArray, stamp_ns: int, mask: BoolArray | None = None) -> ByteArray:
        """The frame, (h, w), with other grey values; itself where they stay.

        mask: (h, w), False where it does not show the scene, which is not looked at, but changed like the rest.
        """
        some = np.ascontiguousarray(gray[::STRIDE, ::STRIDE])
        size = (min(CELLS, some.shape[1]), max(1, min(some.shape[0], round(CELLS * gray.shape[0] / gray.shape[1]))))
        cells = cv2.resize(some, size, interpolation=cv2.INTER_AREA).astype(np.float32)
        if mask is not None:
            scene = mask[::STRIDE, ::STRIDE]
            cells[~whole_cells(scene, *cells.shape)] = 0.0  # black tells nothing
            some = some[scene] if scene.any() else some
        seconds = (stamp_ns - self._stamp_ns) / NANOSECONDS
        if any(each.cells.shape != cells.shape for each in self._earlier) or not 0.0 < seconds <= MAX_GAP_S:
            self.reset()
            seconds = 0.0
        self._stamp_ns = stamp_ns
        table = _brightened(self._follow(cells, stamp_ns, seconds))
        table = np.rint(_stretched(table, self._followed_range(table, some, seconds)))
        return np.asarray(cv2.LUT(gray, table.astype(np.uint8)), np.uint8) if (table != VALUES).any() else gray

    def _follow(self, cells: FloatArray, stamp_ns: int, seconds: float) -> float:
        """Logarithm of the factor that takes jumps of the exposure out of the frame; 0 where it is like none before.

        Jumps add up, but are undone to no more than a jump over what the exposure is away from that of the last
        seconds, to which smaller changes count too: else what is left of a lamp's steps one way would add up to white.
        """
        for each in self._earlier:
            change = _change(each.cells, cells)
            if change is None:
                continue
            ratio, jumped = change
            level = each.level + ratio
            self._usual_level += (1.0 - kept(seconds, MEMORY_S)) * (level - self._usual_level)
            whole = self._usual_level - level
            log_gain = kept((stamp_ns - each.stamp_ns) / NANOSECONDS, MEMORY_S) * each.log_gain - jumped * ratio
            log_gain = min(max(log_gain, min(0.0, whole) - LEAST_JUMP), max(0.0, whole) + LEAST_JUMP)
            self._earlier = [_Seen(cells, level, log_gain, stamp_ns)]
            return log_gain
        self._earlier = [_Seen(cells, self._usual_level, 0.0, stamp_ns), *self._earlier[-1:]]
        return 0.0

    def _followed_range(self, table: DoubleArray, some: ByteArray, seconds: float) -> DoubleArray:
        """(2,) percentiles of the grey values, by ``table``, over time, at least a share as wide as the frame's own."""
        below = np.bincount(some.ravel(), minlength=256).cumsum()
        now = table[np.searchsorted(below, below[-1] * np.array([LOW_PERCENT, HIGH_PERCENT]) / 100.0)]
        if now[1] - now[0] < LEAST_CONTRAST:
            return now if self._range is None else self._range
        if self._range is None:
            self._range = now
        least = (now[1] - now[0]) / OTHER_CONTRAST
        far_more = least / (self._range[1] - self._range[0])
        self._range = self._range + (1.0 - kept(seconds, MEMORY_S)) / max(1.0, far_more) * (now - self._range)
        contrast = self._range[1] - self._range[0]
        wider = (least - contrast) / (OTHER_CONTRAST * least - contrast) if least > contrast else 0.0
        used: DoubleArray = self._range + wider * (now - self._range)
        return used + _off(used, now)


def _change(before: FloatArray, now: FloatArray) -> tuple[float, bool] | None:
    """Logarithm of the factor from cells ``before`` to those ``now``, and whether the exposure jumped.

    None where the pictures are not alike: their cells differ by no less than those of one of them among themselves.
    Over neighbouring frames of real clips, jerked by 8 px too, it is up to 1.0 times, after cuts and in damaged
    pictures from 1.2 times on.
    """
    usable = (np.minimum(now, before) > DARKEST) & (np.maximum(now, before) < BRIGHTEST)
    if np.count_nonzero(usable) < MIN_CELLS:
        return None
    here, there = np.log(now[usable]), np.log(before[usable])
    ratios = here - there
    typical, spread = _median_and_spread(ratios)
    if spread >= min(_median_and_spread(each)[1] for each in (here, there)):
        return None
    error = MEDIAN_ERROR * spread * math.sqrt(ALIKE / len(ratios))
    return typical, abs(typical) >= max(LEAST_JUMP, CERTAIN_ERRORS * error)


def _median_and_spread(values: FloatArray) -> tuple[float, float]:
    """Median, and the deviation of Gaussian values of such a median distance to it."""
    typical = float(np.median(values))
    return typical, MAD_TO_SIGMA * float(np.median(np.abs(values - typical)))


def _brightened(log_gain: float) -> DoubleArray:
    """(256,) grey values times a factor; what is overexposed tells nothing and stays."""
    share = np.clip((OVEREXPOSED - VALUES) / (OVEREXPOSED - BRIGHTEST), 0.0, 1.0)
    values = np.clip(np.exp(share * log_gain) * VALUES, 0.0, 255.0)
    return np.asarray(np.maximum.accumulate(values), np.float64)


def _off(low_high: DoubleArray, now: DoubleArray) -> float:
    """By how much ``low_high`` has to go up or down for a frame with percentiles ``now`` not to become white or black.

    A scene that is brighter than those before it, or an exposure that goes up slowly, has its contrast elsewhere.
    """
    stretch = _stretch(low_high)
    if stretch <= 1.0:
        return 0.0
    low, high = _unlimited(now, low_high).tolist()
    return float(max(high - 255.0, 0.0) + min(low, 0.0)) / (stretch - 1.0)


def _stretched(values: DoubleArray, low_high: DoubleArray) -> DoubleArray:
    """Grey values with at least ``LEAST_RANGE`` between two of them, the lower one where it was if there is room."""
    return values if _stretch(low_high) <= 1.0 else np.clip(_unlimited(values, low_high), 0.0, 255.0)


def _stretch(low_high: DoubleArray) -> float:
    return min(MAX_STRETCH, LEAST_RANGE / max(float(low_high[1] - low_high[0]), 1.0))


def _unlimited(values: DoubleArray, low_high: DoubleArray) -> DoubleArray:
    low = float(low_high[0])
    return np.asarray(min(low, 255.0 - LEAST_RANGE) + _stretch(low_high) * (values - low), np.float64)
