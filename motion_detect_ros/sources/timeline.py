"""When the messages of a recording are due, whatever its clock did."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from itertools import chain, tee

from motion_detect_ros.core.types import LATEST_STAMP_NS, NANOSECONDS
from motion_detect_ros.sources.raw import RawMessage

#: A step of a recording's clock over this is no pause: nobody waits so long, and who recorded it set the clock.
LONGEST_GAP_NS = 24 * 3600 * NANOSECONDS
#: What stands further behind than this was not written late: the clock went back.
LATE_NS = NANOSECONDS


@dataclass(frozen=True)
class Timed:
    """A message in its place.

    ``position_ns``: time after the first message, pauses included, jumps of the recording's clock not; never less
    than that of the message before. ``clock_ns``: what the recording's clock showed then. ``jump_ns``: how far the
    message was recorded from the one before, where that is no time that passed; else 0.
    """

    position_ns: int
    clock_ns: int
    jump_ns: int
    message: RawMessage

    @property
    def jump(self) -> str:
        """The jump in words."""
        return (f'a message on {self.message.topic} was recorded {self.jump_ns / NANOSECONDS:+.1f} s '
                'from the time of those before it')


def timeline(messages: Iterable[RawMessage]) -> Iterator[Timed]:
    """Messages with the time at which they are to be played, in the order in which they are recorded.

    A message that stands a little behind a later one was written late: it turns nothing back. One whose time is
    another than that of its neighbours on both sides stands by itself: it is played in its place. Where all that
    follows has another time, the recording's clock was set: it shows that time from then on.
    """
    clock_ns, position_ns = None, 0
    these, next_ones = tee(messages)
    next(next_ones, None)
    for message, following in zip(these, chain(next_ones, (None,)), strict=False):
        stamp_ns, jump_ns = message.log_stamp_ns, 0
        possible = 0 <= stamp_ns <= LATEST_STAMP_NS
        if clock_ns is None:
            clock_ns = stamp_ns if possible else 0
        elif possible and _goes_on(clock_ns, stamp_ns) and not _is_ahead(clock_ns, stamp_ns, following):
            position_ns += max(0, stamp_ns - clock_ns)
            clock_ns = max(clock_ns, stamp_ns)
        else:
            jump_ns = stamp_ns - clock_ns
            if possible and following is not None and not _goes_on(clock_ns, following.log_stamp_ns):
                clock_ns = stamp_ns
        yield Timed(position_ns, clock_ns, jump_ns, message)


def _goes_on(from_ns: int, to_ns: int) -> bool:
    return -LATE_NS <= to_ns - from_ns <= LONGEST_GAP_NS


def _is_ahead(clock_ns: int, stamp_ns: int, following: RawMessage | None) -> bool:
    """Whether the next message goes on from before this one, and not from it."""
    return (following is not None and _goes_on(clock_ns, following.log_stamp_ns)
            and not _goes_on(stamp_ns, following.log_stamp_ns))
