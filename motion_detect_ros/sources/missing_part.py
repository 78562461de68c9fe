"""A file that belongs to a bag and is not there, or is no bag."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

from motion_detect_ros.sources.raw import RawMessage, TopicInfo


@dataclass(frozen=True)
class MissingPart:
    """A ``BagStorage`` without messages. ``damaged``: which file, and what is wrong with it."""

    damaged: str | None
    topics: tuple[TopicInfo, ...] = ()

    def messages(self, topics: frozenset[str] | None) -> Iterator[RawMessage]:
        """None."""
        yield from ()

    def close(self) -> None:
        """Nothing is open."""
