"""Signals that end a program as Ctrl-C does."""

from __future__ import annotations

import signal
from types import FrameType


def interrupt_once(*numbers: signal.Signals) -> None:
    """From now on the first of these signals raises KeyboardInterrupt, so that outputs are closed properly; after it
    all of them change nothing, as a second one would end the closing.
    """
    def interrupt(_number: int, _frame: FrameType | None) -> None:
        for each in numbers:
            signal.signal(each, signal.SIG_IGN)
        raise KeyboardInterrupt

    for each in numbers:
        signal.signal(each, interrupt)
