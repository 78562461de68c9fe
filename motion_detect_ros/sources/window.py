"""The part of a recording that is wanted: from a moment on, for a while, every Nth picture."""

from __future__ import annotations

import math
from dataclasses import dataclass
from enum import Enum, auto

from motion_detect_ros.core.errors import SourceError
from motion_detect_ros.core.types import NANOSECONDS


class Choice(Enum):
    """What a window says to one picture."""

    SKIP = auto()
    TAKE = auto()
    END = auto()  # this and all later ones are left out


@dataclass(frozen=True)
class Window:
    """``start_s``: seconds after the first picture; ``duration_s``: seconds from there on, None up to the end.

    ``every``: 1 takes all pictures in between, N each Nth of them, beginning with the first.
    """

    start_s: float = 0.0
    duration_s: float | None = None
    every: int = 1

    def __post_init__(self) -> None:
        """Raises: SourceError for values that are no times or numbers of pictures."""
        if not 0 <= self.start_s < math.inf:
            raise SourceError(f'start: expected a number of seconds from 0 on, got {self.start_s:g}')
        if self.duration_s is not None and not 0 < self.duration_s < math.inf:
            raise SourceError(f'duration: expected a number of seconds over 0, got {self.duration_s:g}')
        if self.every < 1:
            raise SourceError(f'every: expected 1 or more, got {self.every}')

    @property
    def by_time(self) -> bool:
        """Whether it leaves anything out for its time."""
        return self.start_s > 0 or self.duration_s is not None

    def __str__(self) -> str:
        return (f'from {self.start_s:g} s' + (f' for {self.duration_s:g} s' if self.duration_s is not None else '')
                + (f', one frame in {self.every}' if self.every > 1 else ''))


#: All pictures.
WHOLE = Window()


class Selection:
    """Applies a window to one pass over a recording, picture after picture in the order of time."""

    def __init__(self, window: Window) -> None:
        self._window = window
        self._begin_ns: int | None = None
        self._end_ns: float = math.inf
        self._first_index: int | None = None

    def judge(self, index: int, stamp_ns: int) -> Choice:
        """What to do with the picture at position ``index`` of the source, taken or recorded at ``stamp_ns``, ns.

        Once the window has begun, a clock that goes back loses nothing.
        """
        if self._begin_ns is None:
            self._begin_ns = stamp_ns + round(self._window.start_s * NANOSECONDS)
            if self._window.duration_s is not None:
                self._end_ns = self._begin_ns + round(self._window.duration_s * NANOSECONDS)
        if stamp_ns >= self._end_ns:
            return Choice.END
        if self._first_index is None:
            if stamp_ns < self._begin_ns:
                return Choice.SKIP
            self._first_index = index
        return Choice.SKIP if (index - self._first_index) % self._window.every else Choice.TAKE
