"""Telling that kernels are being compiled, which takes up to a minute, once after an installation."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import contextmanager

from numba.core import event

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


@contextmanager
def compilation_told(tell: Callable[[int], None]) -> Iterator[None]:
    """Calls ``tell(number)`` as the compilation of each kernel begins, numbered from 1."""
    counter = _Counter(tell)
    event.register(_COMPILE, counter)  # type: ignore[no-untyped-call]
    try:
        yield
    finally:
        event.unregister(_COMPILE, counter)  # type: ignore[no-untyped-call]
