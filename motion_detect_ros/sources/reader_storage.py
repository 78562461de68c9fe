"""What the package rosbags reads, of ROS 1 or of ROS 2, as ``BagStorage``."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections import Counter
from collections.abc import Iterator
from itertools import repeat
from pathlib import Path
from typing import TYPE_CHECKING, ClassVar

from motion_detect_ros.core.errors import SourceError
from motion_detect_ros.sources.raw import LOST, RawMessage, TopicInfo, merged, one_line

if TYPE_CHECKING:
    from rosbags import rosbag1, rosbag2
    from rosbags.interfaces import Connection


class ReaderStorage(ABC):
    """A bag in the hands of a reader of rosbags, with what is the same for all formats.

    ``errors``: what the reader raises on bytes that are not what they should be; ``refusal``: what is said of a file
    that cannot be opened, with ``{}`` for the error.
    """

    errors: ClassVar[tuple[type[Exception], ...]]
    refusal: ClassVar[str]

    def __init__(self, path: Path, reader: rosbag1.Reader | rosbag2.Reader, fault: str = '') -> None:
        """Opens the reader; ``fault``: what is wrong in any case. Raises: SourceError where it cannot."""
        self._path, self._reader, self._fault = path, reader, fault
        self.damaged = f'{path.name}: {fault}' if fault else None
        try:
            reader.open()
        except self.errors as error:
            if not self._of_content(error, opening=True):
                raise
            refusal = self.refusal.format(one_line(error))
            raise SourceError(f'{path}: {refusal}' + (f'; {fault}' if fault else '')) from None

    @property
    def topics(self) -> tuple[TopicInfo, ...]:
        """Topics with counts from the bag's index; several connections may share one."""
        return merged(TopicInfo(connection.topic, connection.msgtype, connection.msgcount, self._encoding(connection))
                      for connection in self._reader.connections)

    def messages(self, topics: frozenset[str] | None = None) -> Iterator[RawMessage]:
        """Messages in order of time; where the file breaks, ``damaged`` says so and the rest is ``LOST``."""
        wanted = [c for c in self._reader.connections if topics is None or c.topic in topics]
        if not wanted:
            return
        given, stamp_ns = Counter[int](), 0
        try:
            for connection, stamp_ns, data in self._reader.messages(wanted):
                given[connection.id] += 1
                yield RawMessage(connection.topic, connection.msgtype, stamp_ns, self._cdr(data, connection.msgtype),
                                 self._encoding(connection))
        except self.errors as error:
            if not self._of_content(error, opening=False):
                raise
            faults = filter(None, (self._fault, f'unreadable from some message on ({one_line(error)})'))
            self.damaged = f'{self._path.name}: {"; ".join(faults)}'
            if self._path.is_file():  # the counts of a folder are its metadata's, and no part comes after it
                for connection in wanted:
                    lost = RawMessage(connection.topic, connection.msgtype, stamp_ns, LOST,
                                      self._encoding(connection))
                    yield from repeat(lost, max(0, connection.msgcount - given[connection.id]))

    def close(self) -> None:
        """Close the file."""
        self._reader.close()

    @abstractmethod
    def _encoding(self, connection: Connection) -> str:
        """Of its messages as ``_cdr`` gives them."""

    def _cdr(self, data: bytes, msgtype: str) -> bytes:
        """A message as ROS 2 has it, where it can be turned into that."""
        return bytes(data)

    def _of_content(self, error: Exception, opening: bool) -> bool:
        """Whether one of ``errors`` speaks of what the file holds; else of the medium it is on, and is passed on."""
        return True
