"""Bags of ROS 1, through rosbags; their messages are turned into those of ROS 2."""

from __future__ import annotations

import errno
import struct
from pathlib import Path

from rosbags.interfaces import Connection
from rosbags.rosbag1 import Reader, ReaderError

from motion_detect_ros.sources.messages import from_ros1, ros1_encoding
from motion_detect_ros.sources.reader_storage import ReaderStorage

ROSBAG1_MAGIC = b'#ROSBAG V'


class Rosbag1Storage(ReaderStorage):
    """A ``.bag`` file as ``BagStorage``, with chunks of any compression that ROS 1 has (none, bz2, lz4)."""

    #: AssertionError and KeyError come out of the reader's index.
    errors = (ReaderError, AssertionError, EOFError, IndexError, KeyError, RuntimeError, ValueError, struct.error,
              OSError)
    refusal = 'not a readable ROS 1 bag: {} (rosbag reindex may repair it)'

    def __init__(self, path: Path) -> None:
        """Raises: SourceError where it cannot be opened, as a recording that was cut off before ``rosbag reindex``."""
        super().__init__(path, Reader(path))

    def _encoding(self, connection: Connection) -> str:
        return ros1_encoding(connection.msgtype)

    def _cdr(self, data: bytes, msgtype: str) -> bytes:
        return from_ros1(data, msgtype)

    def _of_content(self, error: Exception, opening: bool) -> bool:
        """A wrong place in the file raises EINVAL at opening; bz2 raises OSError without a number for bad data."""
        return not isinstance(error, OSError) or error.errno in ((None, errno.EINVAL) if opening else (None,))
