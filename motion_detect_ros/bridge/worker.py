"""A worker thread behind a short mailbox: the executor never waits for a stage, and overload drops frames, not time."""

from __future__ import annotations

import threading
from collections import deque
from collections.abc import Callable
from typing import Generic, TypeVar

Item = TypeVar('Item')


class Worker(Generic[Item]):
    """Runs ``handle`` on submitted items, newest kept: over ``capacity`` the oldest waiting one is dropped.

    jumps: once items had to be dropped, only the newest one that waits is taken, until none waits any more. A few that
    come in a burst are all worked off, but under a load that lasts nothing is older than the item in hand.
    """

    def __init__(
        self, handle: Callable[[Item], None], capacity: int, on_drop: Callable[[int], None], jumps: bool = False,
    ) -> None:
        self._handle = handle
        self._capacity = capacity
        self._on_drop = on_drop
        self._jumps = jumps
        self._late = False
        self._waiting: deque[Item] = deque()
        self._ready = threading.Condition()
        self._running = True
        self._thread = threading.Thread(target=self._run, name='stage', daemon=True)
        self._thread.start()

    def submit(self, item: Item) -> None:
        """Hand over an item; returns at once."""
        with self._ready:
            self._waiting.append(item)
            dropped = max(0, len(self._waiting) - self._capacity)
            for _ in range(dropped):
                self._waiting.popleft()
            self._late |= bool(dropped)
            self._ready.notify()
        if dropped:
            self._on_drop(dropped)

    @property
    def waiting(self) -> int:
        """Items not yet taken in hand."""
        with self._ready:
            return len(self._waiting)

    def stop(self, timeout_s: float = 5.0) -> None:
        """Finish the item in hand, leave the rest, end the thread."""
        with self._ready:
            self._running = False
            self._ready.notify()
        if threading.current_thread() is not self._thread:
            self._thread.join(timeout_s)

    def _run(self) -> None:
        while True:
            with self._ready:
                self._late &= bool(self._waiting)
                self._ready.wait_for(lambda: self._waiting or not self._running)
                if not self._running:
                    return
                passed = len(self._waiting) - 1 if self._jumps and self._late else 0
                for _ in range(passed):
                    self._waiting.popleft()
                item = self._waiting.popleft()
            if passed:
                self._on_drop(passed)
            self._handle(item)
