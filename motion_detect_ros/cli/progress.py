"""How far it is: bars on a terminal, a plain line now and then elsewhere; both on stderr."""

from __future__ import annotations

import sys
from collections.abc import Iterable, Iterator
from functools import cached_property
from typing import TYPE_CHECKING, Self, TypeVar

if TYPE_CHECKING:
    from rich.console import Console
    from rich.progress import Progress, TaskID

Item = TypeVar('Item')

#: Where there is no terminal, a line each so many items: by their number, so that the same run says the same.
PLAIN_EVERY = 500


def track(items: Iterable[Item], total: int | None, description: str) -> Iterator[Item]:
    """The items, while a bar shows how many of ``total`` (None: unknown) have gone by."""
    if not sys.stderr.isatty():
        yield from _plain(items, total, description)
        return
    from rich.console import Console
    from rich.progress import track as rich_track
    yield from rich_track(items, description, total, console=Console(stderr=True))


def _plain(items: Iterable[Item], total: int | None, description: str) -> Iterator[Item]:
    for number, item in enumerate(items, 1):
        yield item
        _tell(description, number, total)


def _tell(description: str, number: int, total: int | None) -> None:
    if number and number % PLAIN_EVERY == 0:
        print(f'{description}: {number}' + (f' of {total}' if total else ''), file=sys.stderr, flush=True)


class Board:
    """A bar for every input that is being worked on and one over all; use as a context manager.

    On a terminal lines are printed above the bars; elsewhere there are lines only.
    """

    def __init__(self, inputs: int, console: Console | None = None) -> None:
        """inputs: how many there will be; a bar over all only where they are several. console: instead of stderr's."""
        self._inputs = inputs
        self._given = console
        self._tasks: dict[str, TaskID] = {}
        self._told: dict[str, int] = {}
        self._ended: set[str] = set()
        self._over_all: TaskID | None = None

    @cached_property
    def _bars(self) -> Progress | None:
        if self._given is None and not sys.stderr.isatty():
            return None
        from rich.console import Console
        from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeRemainingColumn
        return Progress(TextColumn('{task.description}', markup=False), BarColumn(), MofNCompleteColumn(),
                        TimeRemainingColumn(), console=self._given or Console(stderr=True))

    def advance(self, name: str, done: int, total: int | None) -> None:
        """``done`` of the ``total`` frames of the input ``name`` are behind us; ignored for one that has ended."""
        if name in self._ended:
            return
        if self._bars is None:
            if done - self._told.get(name, 0) >= PLAIN_EVERY:
                self._told[name] = done - done % PLAIN_EVERY
                _tell(name, self._told[name], total)
            return
        if name not in self._tasks:
            self._tasks[name] = self._bars.add_task(name, total=total)
        self._bars.update(self._tasks[name], completed=done, total=total)

    def end(self, name: str) -> None:
        """The input ``name`` is done, or will not be."""
        self._ended.add(name)
        if self._bars is not None:
            if name in self._tasks:
                self._bars.remove_task(self._tasks.pop(name))
            if self._over_all is not None:
                self._bars.advance(self._over_all)

    def restart(self, name: str) -> None:
        """The input ``name`` begins anew."""
        self._ended.discard(name)
        self._told.pop(name, None)
        if self._bars is not None and name in self._tasks:
            self._bars.reset(self._tasks[name])

    def say(self, line: str, error: bool = False) -> None:
        """Print a line, on stderr for an error."""
        if self._bars is not None and self._given is None and (error or sys.stdout.isatty()):
            self._bars.console.print(line, markup=False, highlight=False, soft_wrap=True)
        else:
            print(line, file=sys.stderr if error else sys.stdout, flush=True)

    def __enter__(self) -> Self:
        if self._bars is not None:
            self._bars.start()
            if self._inputs > 1:
                self._over_all = self._bars.add_task('inputs', total=self._inputs)
        return self

    def __exit__(self, *_: object) -> None:
        if self._bars is not None:
            self._bars.stop()
