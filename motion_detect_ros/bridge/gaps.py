"""Images that were published and never arrived, from the gaps between the stamps of those that did."""

from __future__ import annotations

from collections import deque
from dataclasses import dataclass

import numpy as np

from motion_detect_ros.core.types import NANOSECONDS

#: Gaps looked at, and how many it takes to say anything.
WINDOW, ENOUGH = 50, 10
#: This share of the gaps is shorter than the usual period or equal to it, however many images are lost.
SHORT_SHARE = 0.1
#: A gap is a whole number of periods where it is so close to one, periods; that must hold for most of them.
CLOSE_PERIODS, MOST = 0.2, 0.8


@dataclass(frozen=True)
class Losses:
    """``published_hz``: estimated rate of the publisher; ``share``: of its images that did not arrive, 0 to 1."""

    published_hz: float
    share: float


class GapWatch:
    """Estimates the publisher's rate: a gap of three periods is two images that were lost."""

    def __init__(self) -> None:
        self._gaps: deque[int] = deque(maxlen=WINDOW)
        self._latest: int | None = None

    def add(self, stamp_ns: int) -> None:
        """An image has arrived; a stamp that is not later than the last one begins anew."""
        if self._latest is not None:
            if stamp_ns > self._latest:
                self._gaps.append(stamp_ns - self._latest)
            else:
                self._gaps.clear()
        self._latest = stamp_ns

    def losses(self) -> Losses | None:
        """The estimate; None before there are enough images, and for stamps without a period."""
        if len(self._gaps) < ENOUGH:
            return None
        gaps = np.array(self._gaps, dtype=float)
        shortest = np.quantile(gaps, SHORT_SHARE, method='lower')
        period = float(np.median(gaps[gaps < (1.0 + CLOSE_PERIODS) * shortest]))
        periods = np.maximum(1.0, np.round(gaps / period))
        if np.mean(np.abs(gaps / period - periods) < CLOSE_PERIODS) < MOST:
            return None
        return Losses(NANOSECONDS / period, 1.0 - len(gaps) / float(periods.sum()))
