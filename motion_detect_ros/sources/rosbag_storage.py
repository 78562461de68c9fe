"""Bags in SQLite (db3) and compressed bag folders, through rosbags."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

import apsw
from rosbags.rosbag2 import Reader
from rosbags.rosbag2.errors import ReaderError

from motion_detect_ros.core.errors import SourceError
from motion_detect_ros.sources.raw import RawMessage, TopicInfo, one_line

SQLITE_MAGIC = b'SQLite format 3\x00'

_READ_ERRORS = (ReaderError, apsw.Error, OSError, ValueError)


class RosbagStorage:
    """A db3 file, or any bag folder rosbags can read, as ``BagStorage``."""

    def __init__(self, path: Path) -> None:
        """Raises: SourceError where rosbags cannot open it."""
        self._path = path
        self.damaged: str | None = None
        self._reader = Reader(path)
        try:
            self._reader.open()
        except _READ_ERRORS as error:
            raise SourceError(f'{path}: not a readable bag: {one_line(error)}') from None

    @property
    def topics(self) -> tuple[TopicInfo, ...]:
        """Topics with counts from the bag's own index."""
        return tuple(TopicInfo(connection.topic, connection.msgtype, connection.msgcount)
                     for connection in self._reader.connections)

    def messages(self, topics: frozenset[str] | None = None) -> Iterator[RawMessage]:
        """Messages in order of time; where the file breaks, ``damaged`` says so and the rest is left out."""
        wanted = [c for c in self._reader.connections if topics is None or c.topic in topics]
        if not wanted:
            return
        try:
            for connection, stamp_ns, data in self._reader.messages(wanted):
                yield RawMessage(connection.topic, connection.msgtype, stamp_ns, bytes(data))
        except _READ_ERRORS as error:
            self.damaged = f'{self._path.name}: unreadable from some message on ({one_line(error)})'

    def close(self) -> None:
        """Close the file."""
        self._reader.close()
