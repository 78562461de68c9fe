"""Iterating in a thread of its own, a few items ahead of who uses them."""

from __future__ import annotations

import queue
import threading
from collections.abc import Iterable, Iterator
from typing import Generic, TypeVar

Item = TypeVar('Item')

#: Items that may wait.
DEPTH = 2
#: How often a thread that waits for room looks whether it is still wanted, seconds.
LOOK_S = 0.2


class _End:
    def __init__(self, error: BaseException | None = None) -> None:
        self.error = error


class Ahead(Generic[Item]):
    """The items of ``items`` in their order, made in a thread; what it raises comes after the items before.

    Use with ``with``: leaving ends the thread, and with it the iteration, between two items.
    """

    def __init__(self, items: Iterable[Item], depth: int = DEPTH) -> None:
        self._items = items
        self._waiting: queue.Queue[Item | _End] = queue.Queue(depth)
        self._wanted = True
        self._thread = threading.Thread(target=self._run, name='ahead', daemon=True)

    def __enter__(self) -> Ahead[Item]:
        self._thread.start()
        return self

    def __exit__(self, *_: object) -> None:
        self._wanted = False
        self._thread.join()

    def __iter__(self) -> Iterator[Item]:
        while True:
            item = self._waiting.get()
            if not isinstance(item, _End):
                yield item
                continue
            if item.error is not None:
                raise item.error
            return

    def _run(self) -> None:
        end = _End()
        try:
            for item in self._items:
                if not self._put(item):
                    return
        except BaseException as error:  # raised again by who iterates
            end = _End(error)
        self._put(end)

    def _put(self, item: Item | _End) -> bool:
        while self._wanted:
            try:
                self._waiting.put(item, timeout=LOOK_S)
            except queue.Full:
                continue
            return True
        return False
