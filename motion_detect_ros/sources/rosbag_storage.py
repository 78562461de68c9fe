"""Bags in SQLite (db3) and compressed bag folders, through rosbags."""

from __future__ import annotations

from pathlib import Path

import apsw
from rosbags.rosbag2 import Reader
from rosbags.rosbag2.errors import ReaderError

from motion_detect_ros.sources.raw import TopicInfo
from motion_detect_ros.sources.reader_storage import ReaderStorage

SQLITE_MAGIC = b'SQLite format 3\x00'


class RosbagStorage(ReaderStorage):
    """A db3 file, or any bag folder rosbags can read, as ``BagStorage``."""

    errors = ReaderError, apsw.Error, OSError, ValueError
    refusal = 'not a readable bag: {}'

    def __init__(self, path: Path) -> None:
        """Raises: SourceError where rosbags cannot open it."""
        super().__init__(path, Reader(path))

    @property
    def topics(self) -> tuple[TopicInfo, ...]:
        """Topics with counts from the bag's own index."""
        return tuple(TopicInfo(connection.topic, connection.msgtype, connection.msgcount)
                     for connection in self._reader.connections)
