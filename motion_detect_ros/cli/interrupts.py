"""Signals that end a program as Ctrl-C does."""

from __future__ import annotations

import signal
import threading
from collections.abc import Iterator
from contextlib import contextmanager
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


@contextmanager
def held_back() -> Iterator[None]:
    """SIGINT, SIGTERM and SIGHUP that would raise something inside do so at the end: what is made there, as a process,
    is known by then to whoever ends it. Changes nothing in other threads than the main one.
    """
    held: list[int] = []
    numbers = (signal.SIGINT, signal.SIGTERM, signal.SIGHUP)
    handlers = {number: signal.getsignal(number) for number in numbers if callable(signal.getsignal(number))}
    if threading.current_thread() is not threading.main_thread():
        handlers.clear()
    try:
        for number in handlers:
            signal.signal(number, lambda number, _: held.append(number))
        yield
    finally:
        for number, handler in handlers.items():
            signal.signal(number, handler)
    for each in held:
        signal.raise_signal(each)
