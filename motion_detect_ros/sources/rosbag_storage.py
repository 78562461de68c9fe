"""Bags in SQLite (db3) and compressed bag folders, through rosbags."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import cast

import apsw
from rosbags.interfaces import Connection, ConnectionExtRosbag2
from rosbags.rosbag2 import Reader
from rosbags.rosbag2.errors import ReaderError

from motion_detect_ros.sources.raw import CDR
from motion_detect_ros.sources.reader_storage import ReaderStorage

SQLITE_MAGIC = b'SQLite format 3\x00'


class RosbagStorage(ReaderStorage):
    """A db3 file, or any bag folder rosbags can read, as ``BagStorage``."""

    errors = ReaderError, apsw.Error, OSError, ValueError
    refusal = 'not a readable bag: {}'

    def __init__(self, path: Path) -> None:
        """Raises: SourceError where rosbags cannot open it."""
        with _plain_name(path) as plain:
            super().__init__(path, Reader(plain), _unread_log(path))

    def _encoding(self, connection: Connection) -> str:
        return cast(ConnectionExtRosbag2, connection.ext).serialization_format or CDR


@contextmanager
def _plain_name(path: Path) -> Iterator[Path]:
    """A name for a file that is to be opened: rosbags puts it into an address as it is, where these mean something."""
    if not set('?#%') & set(str(path)):
        yield path
        return
    with TemporaryDirectory() as folder:
        link = Path(folder, f'bag{path.suffix}')
        link.symlink_to(path.absolute())
        yield link


def _unread_log(path: Path) -> str:
    """What a recorder that was killed left in SQLite's write-ahead log, which rosbags does not look at."""
    log = path.with_name(f'{path.name}-wal')
    size = log.stat().st_size if log.is_file() else 0
    cure = f'they are taken over by: sqlite3 {path.name} "PRAGMA wal_checkpoint(TRUNCATE)"'
    return f'{size} bytes of {log.name} are not read; {cure}' if size else ''
