"""What a bag holds, before anything is decoded."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from typing import Protocol

#: Encoding of the messages of ROS 2, the only one that is read and played.
CDR = 'cdr'


@dataclass(frozen=True)
class TopicInfo:
    """One topic of a bag: its name, ROS type (``sensor_msgs/msg/Image``), number of messages, and their encoding."""

    name: str
    msgtype: str
    count: int
    encoding: str = CDR

    @property
    def form(self) -> str:
        """Type of its messages, with their encoding where that is another than usual."""
        return self.msgtype if self.encoding == CDR else f'{self.msgtype} in {self.encoding}'

    def holds(self, message: RawMessage) -> bool:
        """Whether a message is one of its; channels of other types or encodings may share the name."""
        return (message.topic, message.msgtype, message.encoding) == (self.name, self.msgtype, self.encoding)


#: In place of the bytes of a message that was recorded and cannot be read any more; no message of ROS has none.
LOST = b''


@dataclass(frozen=True)
class RawMessage:
    """One recorded message. ``log_stamp_ns``: when that was, ns; ``data``: its bytes in ``encoding``, or ``LOST``."""

    topic: str
    msgtype: str
    log_stamp_ns: int
    data: bytes
    encoding: str = CDR


class BagStorage(Protocol):
    """One file (or folder) of a bag, whatever its format."""

    @property
    def topics(self) -> tuple[TopicInfo, ...]:
        """Topics in the order they were recorded first."""

    @property
    def damaged(self) -> str | None:
        """What is known to be wrong with the file, None for nothing so far."""

    def messages(self, topics: frozenset[str] | None) -> Iterator[RawMessage]:
        """Messages in order of time; all topics for None."""

    def close(self) -> None:
        """Let go of the file."""


def merged(topics: Iterable[TopicInfo]) -> tuple[TopicInfo, ...]:
    """Topics alike but for the count, as those of several channels or files, as one with all their messages."""
    counts: Counter[tuple[str, str, str]] = Counter()
    for topic in topics:
        counts[topic.name, topic.msgtype, topic.encoding] += topic.count
    return tuple(TopicInfo(name, msgtype, count, encoding) for (name, msgtype, encoding), count in counts.items())


def printable(text: str) -> str:
    """A text with names out of a bag as it can be printed and logged: what is no character to see is escaped."""
    return ''.join(each if each.isprintable() else ascii(each)[1:-1] for each in text)


def one_line(error: Exception) -> str:
    """What a library says of a file, in one line."""
    return ' '.join(str(error).split()) or type(error).__name__
