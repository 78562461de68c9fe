"""Telling that kernels are being compiled, which takes up to a minute, once after an installation; or refusing it."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import contextmanager

from numba.core import event

from motion_detect_ros.core.errors import MotionDetectError

#: What numba calls the compilation of one function; what it loads from its cache is none.
_COMPILE = 'numba:compile'


class _Counter(event.Listener):
    def __init__(self, tell: Callable[[int], None]) -> None:
        self._tell = tell
        self._count = 0

    def on_start(self, _event: event.Event) -> None:
        self._count += 1
        self._tell(self._count)

    def on_end(self, _event: event.Event) -> None:
        pass


class NotCachedError(MotionDetectError):
    """A kernel would have to be compiled."""


class _Refuser(event.Listener):
    def on_start(self, _event: event.Event) -> None:
        raise NotCachedError('a kernel is not in the cache')

    def on_end(self, _event: event.Event) -> None:
        pass


@contextmanager
def _listening(listener: event.Listener) -> Iterator[None]:
    event.register(_COMPILE, listener)  # type: ignore[no-untyped-call]
    try:
        yield
    finally:
        event.unregister(_COMPILE, listener)  # type: ignore[no-untyped-call]


@contextmanager
def only_cached() -> Iterator[None]:
    """Raises: NotCachedError instead of compiling, in any thread."""
    with _listening(_Refuser()):
        yield


@contextmanager
def compilation_told(tell: Callable[[int], None]) -> Iterator[None]:
    """Calls ``tell(number)`` as the compilation of each kernel begins, numbered from 1."""
    with _listening(_Counter(tell)):
        yield
