"""Jumps of the exposure, taken out: lamps that flicker, a camera that adapts; trackers take them for motion."""

from __future__ import annotations

import math

import cv2
import numpy as np

from motion_detect_ros.core.forgetting import kept
from motion_detect_ros.core.geometry.robust import MAD_TO_SIGMA
from motion_detect_ros.core.types import NANOSECONDS, ByteArray, DoubleArray, FloatArray

#: Frames are compared by the means of so many cells along their width, at most.
CELLS = 64
#: Grey values in the range of the first two are neither black nor bright; those from the last one on stay as they are.
DARKEST, BRIGHTEST, OVEREXPOSED = 12.0, 210.0, 250.0
#: The exposure has jumped where the logarithms of so many cells changed by at least this in the median, and by so many
#: standard errors of it; neighbours, of which so many count as one, err alike. Smaller changes trackers bear, and a
#: scene that comes closer looks like them.
MIN_CELLS, LEAST_JUMP, CERTAIN_ERRORS, ALIKE = 200, 0.08, 3.0, 8.0
#: Standard error of a median over that of a mean, of Gaussian errors.
MEDIAN_ERROR = math.sqrt(math.pi / 2.0)
#: Over this time constant what was taken out comes back, seconds: the light has changed for good.
MEMORY_S = 2.0
#: A longer gap than this starts anew, seconds.
MAX_GAP_S = 1.0


class ExposureFollower:
    """Keeps frames as bright as the ones before them."""

    def __init__(self) -> None:
        self.reset()

    def reset(self) -> None:
        """The next frame is taken as it is."""
        self._last: FloatArray | None = None
        self._stamp_ns = 0
        self._log_gain = 0.0

    def step(self, gray: ByteArray, stamp_ns: int) -> ByteArray:
        """The frame, (h, w), as bright as the last one was; itself where the exposure has not jumped of late."""
        height, width = gray.shape
        size = (min(CELLS, width), max(1, min(height, round(CELLS * height / width))))
        cells = cv2.resize(gray, size, interpolation=cv2.INTER_AREA).astype(np.float32)
        seconds = (stamp_ns - self._stamp_ns) / NANOSECONDS
        if self._last is None or self._last.shape != cells.shape or not 0.0 < seconds <= MAX_GAP_S:
            self._log_gain = 0.0
        else:
            self._log_gain *= kept(seconds, MEMORY_S)
            self._log_gain += _jump(cells * np.float32(math.exp(self._log_gain)), self._last)
        self._last, self._stamp_ns = cells * np.float32(math.exp(self._log_gain)), stamp_ns
        table = _brightened(self._log_gain)
        changed = np.rint(table) != np.arange(256)
        return np.asarray(cv2.LUT(gray, np.rint(table).astype(np.uint8)), np.uint8) if changed.any() else gray


def _jump(now: FloatArray, before: FloatArray) -> float:
    """Logarithm of the factor from cells ``now`` to those ``before``, 0 where the exposure did not jump."""
    usable = (np.minimum(now, before) > DARKEST) & (np.maximum(now, before) < BRIGHTEST)
    if np.count_nonzero(usable) < MIN_CELLS:
        return 0.0
    ratios = np.log(before[usable] / now[usable])
    typical = float(np.median(ratios))
    spread = MAD_TO_SIGMA * float(np.median(np.abs(ratios - typical)))
    error = MEDIAN_ERROR * spread * math.sqrt(ALIKE / len(ratios))
    return typical if abs(typical) >= max(LEAST_JUMP, CERTAIN_ERRORS * error) else 0.0


def _brightened(log_gain: float) -> DoubleArray:
    """(256,) grey values times a factor; what is overexposed tells nothing and stays."""
    values = np.arange(256.0)
    share = np.clip((OVEREXPOSED - values) / (OVEREXPOSED - BRIGHTEST), 0.0, 1.0)
    return np.asarray(np.clip(np.exp(share * log_gain) * values, 0.0, 255.0), np.float64)
