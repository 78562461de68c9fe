"""Sums of frame periods against times in seconds: in whole frames, whatever the jitter of the stamps."""

from __future__ import annotations

import math

#: Share of a frame's period that sums of periods may miss, for jitter. Beyond that times round up to whole frames:
#: two frames of 20 Hz are not 0.12 s, and two chance candidates in a row must not confirm each other.
TOLERANCE = 0.25
#: What is not done in every frame is done in every second one at most.
LEAST_FRAMES = 2


def reached(total_s: float, seconds: float, period_s: float) -> bool:
    """Whether a sum of periods is at least ``seconds``, up to jitter of the last one."""
    return total_s >= seconds - TOLERANCE * period_s


def exceeded(total_s: float, seconds: float, period_s: float) -> bool:
    """Whether a sum of periods is over ``seconds``, by more than jitter of the last one."""
    return total_s > seconds + TOLERANCE * period_s


class Every:
    """Says which frames something is done in: the first one, then those that are ``seconds`` later.

    Never in two frames running, however far apart they are: who is late because a frame costs too much would be so the
    more by doing everything in each. Only ``eager`` ones are, at the start, where there is nothing yet to go on with.
    """

    def __init__(self, seconds: float, eager: bool = False) -> None:
        """seconds: 0 = in every frame; eager: in those less than ``seconds`` after the first one too."""
        self._seconds, self._eager = seconds, eager
        self.reset()

    def reset(self) -> None:
        """The next frame is a first one."""
        self._since_s, self._frames = math.inf, LEAST_FRAMES
        self._turns, self._in_turn = 0, False

    def due(self, dt_s: float) -> bool:
        """Call once for each frame. dt_s: since the one before, seconds."""
        self._since_s, self._frames = self._since_s + dt_s, self._frames + 1
        late = reached(self._since_s, self._seconds, dt_s)
        self._in_turn = self._seconds == 0.0 or (self._frames >= LEAST_FRAMES and late)
        return self._in_turn or (self._eager and self._turns == 1 and not late)

    def done(self) -> None:
        """It was done in the frame that ``due`` was last called for; an early one does not shift the next turn."""
        if self._in_turn:
            self._since_s, self._frames, self._turns = 0.0, 0, self._turns + 1
