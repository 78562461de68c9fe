"""How many threads work on a frame.

Those of OpenCV wait for their next call in a loop, which costs up to a quarter of all processor time. So, once ``use``
is called, two threads are this package's own, and OpenCV keeps to the one that calls it; of more, OpenCV's have a use
inside of its dense flow. Its own begin on another processor than the one that gives them work.
"""

from __future__ import annotations

import ctypes
import threading
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import Future, ThreadPoolExecutor
from contextlib import contextmanager, suppress
from os import getpid, sched_getaffinity, sched_setaffinity
from typing import Any, TypeVar

import cv2

#: The C library, called without giving Python's lock away.
_LIBRARY = ctypes.PyDLL(None)

Part = TypeVar('Part')
Outcome = TypeVar('Outcome')

#: So many threads and fewer have enough to do without OpenCV's.
OWN = 2
#: Threads of this process; empty: nobody has said how many, and there are OpenCV's.
_count: list[int] = []


def threads() -> int:
    """How many there are, the caller's own included."""
    return _count[0] if _count else cv2.getNumThreads()


def use(count: int) -> None:
    """So many from now on in this process, at least 1; 0 = as many as there are."""
    _count[:] = [count or threads()]
    cv2.setNumThreads(1 if threads() <= OWN else threads())


@contextmanager
def limited(count: int) -> Iterator[None]:
    """So many within the block; 0 = as many as there are."""
    before, opencv = list(_count), cv2.getNumThreads()
    use(count)
    try:
        yield
    finally:
        _count[:] = before
        cv2.setNumThreads(opencv)


def _opencv_keeps_to_callers() -> bool:
    """Whether OpenCV has no threads beside the one that calls it."""
    return cv2.getNumThreads() <= 1


class ApartPool(ThreadPoolExecutor):
    """Threads that begin on another processor than the one that gives them work.

    Linux often wakes a thread where who wakes it goes on running, and moves it up to a millisecond later, which is
    about what a part takes. Not where OpenCV has threads: those that it starts from here would be kept apart for good.
    """

    def __init__(self, count: int, name: str) -> None:
        """count: of threads; name: of them."""
        self._ids: list[int] = []
        self._kept: tuple[int, set[int]] = (0, set())
        super().__init__(count, name, initializer=lambda: self._ids.append(threading.get_native_id()))

    def submit(self, fn: Callable[..., Outcome], /, *args: Any, **kwargs: Any) -> Future[Outcome]:
        """As of the base class; where the system cannot say which processors there are, no more than that."""
        if _opencv_keeps_to_callers():
            with suppress(OSError, AttributeError):
                self._keep_apart()
        return super().submit(fn, *args, **kwargs)

    def _keep_apart(self) -> None:
        """From the caller's processor, where the process may use another. Raises: OSError, AttributeError."""
        allowed = sched_getaffinity(getpid())  # of the main thread: the caller may be kept to some of them itself
        keep = len(self._ids), allowed - {_LIBRARY.sched_getcpu()} or allowed
        if keep != self._kept:
            for each in self._ids[:keep[0]]:
                sched_setaffinity(each, keep[1])
            self._kept = keep


class Helpers:
    """Threads that do parts of one thing beside their caller, where OpenCV has one thread only."""

    def __init__(self, name: str) -> None:
        """name: of the threads."""
        self._name = name
        self._pools: dict[int, ApartPool] = {}

    @staticmethod
    def parts(size: int, least: int) -> int:
        """In how many parts to do something of that size, of which less than ``least`` is not worth a thread."""
        return max(1, min(threads(), size // least)) if _opencv_keeps_to_callers() else 1

    def share(self, function: Callable[[Part], Outcome], parts: Sequence[Part]) -> list[Outcome]:
        """``function`` of every part, in their order, the first by the caller. Raises: what it raises."""
        if len(parts) == 1:
            return [function(parts[0])]
        pool = self._pools.get(len(parts)) or self._pools.setdefault(
            len(parts), ApartPool(len(parts) - 1, self._name))
        waiting = [pool.submit(function, part) for part in parts[1:]]
        done = [function(parts[0])]
        for part, future in zip(parts[1:], waiting, strict=True):  # who waits for a busy thread does its work
            done.append(function(part) if future.cancel() else future.result())
        return done


#: Of this process: as many threads as can be of use, whatever is shared out.
HELPERS = Helpers('helpers')
