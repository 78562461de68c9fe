"""Joining messages that belong to one image: by exactly equal stamps, in bounded memory, with drops counted."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from motion_detect_ros.core.stamp_order import StampOrder, Verdict

#: Bytes of messages over its capacity that a join keeps at most, and sets in all: pictures wait for a stage that takes
#: long, and those that it leaves out wait with them.
ROOM_BYTES, MOST_SETS = 64 << 20, 300


def size_of(msg: Any) -> int:
    """Bytes of a message that grow with the picture."""
    return len(getattr(msg, 'data', ()))


class ExactJoin:
    """Collects one item of every name for each stamp. Not thread-safe: feed it from one executor."""

    def __init__(
        self, names: tuple[str, ...], capacity: int, reorder_s: float = 0.0, size: Callable[[Any], int] | None = None,
    ) -> None:
        """capacity: sets that may wait; with ``size``, bytes of an item, more of them while there is room.

        reorder_s: as for ``StampOrder``, of the first name, the images; the others come from stages that have judged
        these, so that an earlier stamp is always of a new run of the clock.
        """
        self._capacity, self._size = capacity, size
        self._waiting: dict[int, dict[str, Any]] = {}
        self._orders = {name: StampOrder(0.0 if number else reorder_s) for number, name in enumerate(names)}
        self.verdict = Verdict.NEXT
        self.dropped = 0
        #: Incomplete sets that the latest item made it discard, by stamp.
        self.given_up: tuple[dict[str, Any], ...] = ()

    def add(self, name: str, stamp_ns: int, item: Any) -> tuple[Any, ...] | None:
        """All items of ``stamp_ns`` in the order of the names, once the last has come; None until then.

        An item whose stamp was seen already or is late is left out; ``verdict`` says so until the next one.

        A complete set discards sets of earlier stamps, which can only be incomplete, and counts them as dropped; so do
        sets over ``capacity`` for which there is no room, oldest arrival first. Where the stamps of a name go back, its
        items of later times are of another run of the clock and must not meet the present one: they are forgotten.
        """
        self.given_up = ()
        self.verdict = self._orders[name].judge(stamp_ns)
        if not self.verdict.usable:
            return None
        if self.verdict == Verdict.JUMP:
            self._forget_later(name, stamp_ns)
        items = self._waiting.setdefault(stamp_ns, {})
        items[name] = item
        if len(items) == len(self._orders):
            del self._waiting[stamp_ns]
            self._discard([old for old in self._waiting if old < stamp_ns])
            return tuple(items[each] for each in self._orders)
        self._discard(self._too_many())
        return None

    def count(self, name: str, verdict: Verdict) -> int:
        """How many items of a name were judged so."""
        return self._orders[name].counts[verdict]

    def absent(self) -> tuple[str, ...]:
        """Names that the set which has waited longest still lacks."""
        oldest = next(iter(self._waiting.values()), None)
        return () if oldest is None else tuple(name for name in self._orders if name not in oldest)

    def clear(self) -> None:
        """Forget what waits, without counting it."""
        self._waiting.clear()
        self.given_up = ()
        for order in self._orders.values():
            order.reset()

    def _too_many(self) -> list[int]:
        over = list(self._waiting)[:-self._capacity]
        if not over or self._size is None:
            return over
        used = sum(map(self._size, (item for items in self._waiting.values() for item in items.values())))
        for number, stamp in enumerate(over):
            if used <= ROOM_BYTES and len(self._waiting) - number <= MOST_SETS:
                return over[:number]
            used -= sum(map(self._size, self._waiting[stamp].values()))
        return over

    def _forget_later(self, name: str, stamp_ns: int) -> None:
        for stamp, items in self._waiting.items():
            if stamp > stamp_ns:
                items.pop(name, None)
        self._discard([stamp for stamp, items in self._waiting.items() if not items])

    def _discard(self, stamps: list[int]) -> None:
        self.given_up += tuple(self._waiting.pop(stamp) for stamp in sorted(stamps))
        self.dropped += len(stamps)
