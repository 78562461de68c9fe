"""Joining messages that belong to one image: by exactly equal stamps, in bounded memory, with drops counted."""

from __future__ import annotations

from typing import Any


class ExactJoin:
    """Collects one item of every name for each stamp. Not thread-safe: feed it from one executor."""

    def __init__(self, names: tuple[str, ...], capacity: int) -> None:
        self._names = names
        self._capacity = capacity
        self._waiting: dict[int, dict[str, Any]] = {}
        self._latest: dict[str, int] = {}
        self.dropped = 0

    def add(self, name: str, stamp_ns: int, item: Any) -> tuple[Any, ...] | None:
        """All items of ``stamp_ns`` in the order of the names, once the last has come; None until then.

        A complete set discards sets of earlier stamps, which can only be incomplete, and counts them as dropped;
        so do sets over ``capacity``, oldest arrival first. Where the stamps of a name go back, its items of later
        times are of another run of the clock and must not meet the present one: they are forgotten.
        """
        if stamp_ns < self._latest.get(name, stamp_ns):
            self._forget_later(name, stamp_ns)
        self._latest[name] = stamp_ns
        items = self._waiting.setdefault(stamp_ns, {})
        items[name] = item
        if len(items) == len(self._names):
            del self._waiting[stamp_ns]
            self._discard([old for old in self._waiting if old < stamp_ns])
            return tuple(items[each] for each in self._names)
        self._discard(list(self._waiting)[:-self._capacity])
        return None

    def clear(self) -> None:
        """Forget what waits, without counting it."""
        self._waiting.clear()
        self._latest.clear()

    def _forget_later(self, name: str, stamp_ns: int) -> None:
        for stamp, items in self._waiting.items():
            if stamp > stamp_ns:
                items.pop(name, None)
        self._discard([stamp for stamp, items in self._waiting.items() if not items])

    def _discard(self, stamps: list[int]) -> None:
        for stamp in stamps:
            del self._waiting[stamp]
        self.dropped += len(stamps)
