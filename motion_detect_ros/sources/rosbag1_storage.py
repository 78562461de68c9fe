"""Bags of ROS 1, through rosbags; their messages are turned into those of ROS 2."""

from __future__ import annotations

import errno
import struct
from collections.abc import Iterator
from pathlib import Path

from rosbags.rosbag1 import Reader, ReaderError

from motion_detect_ros.core.errors import SourceError
from motion_detect_ros.sources.messages import from_ros1
from motion_detect_ros.sources.raw import RawMessage, TopicInfo, one_line

ROSBAG1_MAGIC = b'#ROSBAG V'

#: What the reader raises on bytes that are not what they should be; AssertionError and KeyError come out of its index.
_READ_ERRORS = (ReaderError, AssertionError, EOFError, IndexError, KeyError, RuntimeError, ValueError, struct.error)


class Rosbag1Storage:
    """A ``.bag`` file as ``BagStorage``, with chunks of any compression that ROS 1 has (none, bz2, lz4)."""

    def __init__(self, path: Path) -> None:
        """Raises: SourceError where it cannot be opened, as a recording that was cut off before ``rosbag reindex``."""
        self._path = path
        self.damaged: str | None = None
        self._reader = Reader(path)
        try:
            self._reader.open()
        except (*_READ_ERRORS, OSError) as error:
            if isinstance(error, OSError) and error.errno not in (None, errno.EINVAL):  # the medium, not its content
                raise
            raise SourceError(f'{path}: not a readable ROS 1 bag: {one_line(error)} (rosbag reindex may repair it)'
                              ) from None

    @property
    def topics(self) -> tuple[TopicInfo, ...]:
        """Topics with counts from the bag's index; several connections may share one."""
        merged: dict[str, TopicInfo] = {}
        for connection in self._reader.connections:
            earlier = merged.get(connection.topic)
            count = connection.msgcount + (earlier.count if earlier else 0)
            merged[connection.topic] = TopicInfo(connection.topic, connection.msgtype, count)
        return tuple(merged.values())

    def messages(self, topics: frozenset[str] | None = None) -> Iterator[RawMessage]:
        """Messages in order of time; where the file breaks, ``damaged`` says so and the rest is left out."""
        wanted = [c for c in self._reader.connections if topics is None or c.topic in topics]
        if not wanted:
            return
        try:
            for connection, stamp_ns, data in self._reader.messages(wanted):
                content = from_ros1(data, connection.msgtype)
                yield RawMessage(connection.topic, connection.msgtype, stamp_ns, content)
        except (*_READ_ERRORS, OSError) as error:
            if isinstance(error, OSError) and error.errno is not None:  # the medium; bz2 raises OSError for bad data
                raise
            self.damaged = f'{self._path.name}: unreadable from some message on ({one_line(error)})'

    def close(self) -> None:
        """Close the file."""
        self._reader.close()
