"""Ends the process after a time, whatever Python does meanwhile.

A thread of Python cannot: Fast DDS 2.14 may wait long for itself where a participant goes while others go too, inside a
call of rclpy that keeps the interpreter to itself.
"""

from __future__ import annotations

import contextlib
import ctypes
from collections.abc import Iterator

#: timer_create(2): the clock, and a function called in a thread of its own.
_CLOCK_MONOTONIC, _SIGEV_THREAD = 1, 2


class _SigEvent(ctypes.Structure):
    """``struct sigevent`` of glibc on 64-bit machines, whose value stands in its low half: 64 bytes."""

    _fields_ = (('value', ctypes.c_int64), ('signo', ctypes.c_int), ('notify', ctypes.c_int),
                ('function', ctypes.c_void_p), ('attributes', ctypes.c_void_p), ('rest', ctypes.c_char * 32))


class _TimeSpec(ctypes.Structure):
    _fields_ = (('tv_sec', ctypes.c_long), ('tv_nsec', ctypes.c_long))


class _TimerSpec(ctypes.Structure):
    _fields_ = (('interval', _TimeSpec), ('value', _TimeSpec))


def exits_in(seconds: float, code: int) -> ctypes.c_void_p | None:
    """The process ends with ``code``, 0 to 255, in ``seconds`` at the latest. Returns the timer, to delete.

    Nothing is flushed then. Where there is no glibc of 2.34 or later, nothing happens, and None is returned.
    """
    glibc, timer = ctypes.CDLL(None), ctypes.c_void_p()
    try:
        event = _SigEvent(value=code, notify=_SIGEV_THREAD, function=ctypes.cast(glibc._exit, ctypes.c_void_p).value)
        made = glibc.timer_create(_CLOCK_MONOTONIC, ctypes.byref(event), ctypes.byref(timer)) == 0
    except AttributeError:
        made = False
    if not made:
        return None
    whole, part = divmod(seconds, 1.0)
    spec = _TimerSpec(value=_TimeSpec(int(whole), int(part * 1e9)))
    glibc.timer_settime(timer, 0, ctypes.byref(spec), None)
    return timer


@contextlib.contextmanager
def exits_after(seconds: float, code: int) -> Iterator[None]:
    """The process ends at once with ``code`` where the block takes longer than ``seconds``, as with ``exits_in``."""
    timer = exits_in(seconds, code)
    try:
        yield
    finally:
        if timer is not None:
            ctypes.CDLL(None).timer_delete(timer)
