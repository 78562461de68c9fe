"""What the stamp of an image says about its place: next, seen already, late, or of a new run of the clock."""

from __future__ import annotations

from collections import Counter
from enum import Enum

from motion_detect_ros.core.types import LATEST_STAMP_NS, NANOSECONDS

#: An image that is late by less than this comes too late to be used; one further back is of another run of the clock.
REORDER_S = 0.3
#: Stamps from here on, nanoseconds (in 2001), are of a clock that shows the date: 0 after them is no stamp.
DATED_NS = 10 ** 9 * NANOSECONDS
#: So many late images in a row whose own stamps increase are a new run too: the clock went back by less.
RUN_OF_LATE = 5


class Verdict(Enum):
    """What is to be done with an image, in the words of the diagnostics."""

    NEXT = 'in order'
    JUMP = 'jumped back'      # to be used, without what was before
    SEEN = 'seen already'     # to be left out, as all that follow
    LATE = 'late'
    MISSING = 'missing'       # 0 again, or after a date: the camera has not stamped it
    NEGATIVE = 'negative'
    BEYOND = 'beyond 2038'    # later than a message can say

    @property
    def usable(self) -> bool:
        """Whether the image is to be processed."""
        return self in {Verdict.NEXT, Verdict.JUMP}


class StampOrder:
    """Judges the stamps of one stream, in the order of arrival; those of usable images increase between jumps."""

    def __init__(self, reorder_s: float = REORDER_S) -> None:
        """reorder_s: limit between late and a jump back, seconds; 0 = every earlier stamp is a jump."""
        self._reorder_ns = round(reorder_s * NANOSECONDS)
        self.counts: Counter[Verdict] = Counter()
        self.reset()

    def reset(self) -> None:
        """Forget earlier stamps; the counts stay."""
        self._latest: int | None = None
        self._left_out = self._late_run = 0

    def judge(self, stamp_ns: int) -> Verdict:
        """What to do with the image of this stamp, nanoseconds; counted in ``counts``."""
        verdict = self._judged(stamp_ns)
        self.counts[verdict] += 1
        if verdict.usable:
            self._latest, self._late_run = stamp_ns, 0
        return verdict

    def _judged(self, stamp_ns: int) -> Verdict:
        if not 0 <= stamp_ns <= LATEST_STAMP_NS:
            return Verdict.NEGATIVE if stamp_ns < 0 else Verdict.BEYOND
        if self._latest is None or stamp_ns > self._latest:
            return Verdict.NEXT
        if stamp_ns == self._latest:
            return Verdict.SEEN if stamp_ns else Verdict.MISSING
        if not stamp_ns and self._latest >= DATED_NS:
            return Verdict.MISSING
        if self._latest - stamp_ns >= self._reorder_ns:
            return Verdict.JUMP
        self._late_run = self._late_run + 1 if self._late_run and stamp_ns > self._left_out else 1
        self._left_out = stamp_ns
        return Verdict.JUMP if self._late_run >= RUN_OF_LATE else Verdict.LATE
