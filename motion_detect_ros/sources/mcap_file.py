"""MCAP files, read from front to back so that a damaged one still gives every intact chunk.

Format: MCAP specification, https://mcap.dev/spec (chunks of records, each with a checksum; summary at the end).
"""

from __future__ import annotations

import errno
from collections import Counter
from collections.abc import Iterable, Iterator
from pathlib import Path

from mcap.reader import make_reader
from mcap.records import Channel, Chunk, McapRecord, Message, Schema, Statistics
from mcap.stream_reader import StreamReader, breakup_chunk
from rosbags.typesys.msg import normalize_msgtype

from motion_detect_ros.sources.messages import from_ros1
from motion_detect_ros.sources.raw import RawMessage, TopicInfo

MAGIC = b'\x89MCAP0\r\n'

#: Encoding of the messages of a ROS 1 bag that was converted to MCAP.
ROS1 = 'ros1'

#: A chunk that announces more than this is damaged; recorders write some megabytes.
MAX_CHUNK_BYTES = 1 << 30


class McapFile:
    """One MCAP file as ``BagStorage``.

    Messages come chunk by chunk in file order, sorted by log time within a chunk: what a recorder writes is in
    order of time then, and memory stays at one chunk.
    """

    def __init__(self, path: Path) -> None:
        """Reads the summary; a file without one is ``damaged`` but readable."""
        self._path = path
        self._schemas: dict[int, Schema] = {}
        self._channels: dict[int, Channel] = {}
        self._statistics: Statistics | None = None
        self._topics: tuple[TopicInfo, ...] | None = None
        self._cut_off = not self._read_summary()
        self._bad_chunks = 0

    @property
    def damaged(self) -> str | None:
        """Missing end, or checksum errors met while reading so far."""
        faults = ['the end is missing (recording was cut off)'] * self._cut_off
        if self._bad_chunks:
            faults.append(f'{self._bad_chunks} unreadable chunk(s) skipped')
        return f'{self._path.name}: {", ".join(faults)}' if faults else None

    @property
    def topics(self) -> tuple[TopicInfo, ...]:
        """From the summary, or by reading the whole file where that is missing."""
        if self._topics is None:
            self._topics = self._summary_topics() or self._counted_topics()
        return self._topics

    def messages(self, topics: frozenset[str] | None = None) -> Iterator[RawMessage]:
        """Every message that can be read; what cannot is added to ``damaged``.

        Nothing is read where the summary says that there are none of ``topics``.
        """
        self._bad_chunks = 0
        summary = self._summary_topics() if topics is not None else ()
        if summary and not any(topic.count and topic.name in topics for topic in summary):  # type: ignore[operator]
            return
        with self._path.open('rb') as stream:
            for record in self._records(StreamReader(
                    stream, emit_chunks=True, record_size_limit=self._path.stat().st_size)):
                if isinstance(record, Chunk):
                    yield from self._chunk_messages(record, topics)
                else:
                    yield from self._learn((record,), topics)

    def close(self) -> None:
        """Nothing stays open between calls."""

    def _records(self, reader: StreamReader) -> Iterator[McapRecord]:
        """Records up to the end, or to the point where the file stops making sense."""
        try:
            yield from reader.records
        except Exception as error:
            if not _is_damage(error):
                raise
            self._cut_off = True

    def _chunk_messages(self, chunk: Chunk, topics: frozenset[str] | None) -> list[RawMessage]:
        try:
            if chunk.uncompressed_size > MAX_CHUNK_BYTES:
                raise ValueError(f'expected at most {MAX_CHUNK_BYTES} bytes, got {chunk.uncompressed_size}')
            records = breakup_chunk(chunk, validate_crc=True)
        except Exception as error:
            if not _is_damage(error):
                raise
            self._bad_chunks += 1
            return []
        return sorted(self._learn(records, topics), key=lambda message: message.log_stamp_ns)

    def _learn(self, records: Iterable[McapRecord], topics: frozenset[str] | None) -> Iterator[RawMessage]:
        """Remember schemas and channels, give the messages of the wanted topics."""
        for record in records:
            if isinstance(record, Schema):
                self._schemas[record.id] = record
            elif isinstance(record, Channel):
                self._channels[record.id] = record
            elif isinstance(record, Message):
                channel = self._channels.get(record.channel_id)  # None: its definition was in an unreadable chunk
                if channel and (topics is None or channel.topic in topics):
                    msgtype = self._msgtype(channel)
                    data = from_ros1(record.data, msgtype) if channel.message_encoding == ROS1 else record.data
                    yield RawMessage(channel.topic, msgtype, record.log_time, data)

    def _msgtype(self, channel: Channel) -> str:
        schema = self._schemas.get(channel.schema_id)
        if schema is None:
            return ''
        return normalize_msgtype(schema.name) if channel.message_encoding == ROS1 else schema.name

    def _read_summary(self) -> bool:
        """Take channels and counts from the end of the file; False where there is no readable end."""
        try:
            with self._path.open('rb') as stream:
                summary = make_reader(stream).get_summary()
        except Exception as error:
            if not _is_damage(error):
                raise
            return False
        if summary is not None:
            self._schemas.update(summary.schemas)
            self._channels.update(summary.channels)
            self._statistics = summary.statistics
        return True

    def _summary_topics(self) -> tuple[TopicInfo, ...]:
        if self._statistics is None:
            return ()
        counts = self._statistics.channel_message_counts
        if self._statistics.message_count and not counts:  # allowed by the format: not available
            return ()
        return _merge((channel.topic, self._msgtype(channel), counts.get(number, 0))
                      for number, channel in self._channels.items())

    def _counted_topics(self) -> tuple[TopicInfo, ...]:
        return _merge((message.topic, message.msgtype, 1) for message in self.messages())


def _merge(entries: Iterable[tuple[str, str, int]]) -> tuple[TopicInfo, ...]:
    """Add up the counts of entries (topic, type, count) of the same topic; several channels may share one."""
    counts: Counter[tuple[str, str]] = Counter()
    for topic, msgtype, count in entries:
        counts[topic, msgtype] += count
    return tuple(TopicInfo(topic, msgtype, count) for (topic, msgtype), count in counts.items())


def _is_damage(error: Exception) -> bool:
    """All but trouble with the medium: the library raises anything on bytes that are not what they should be.

    EINVAL is what it gets for jumping to before the start of a file that is too short.
    """
    return not isinstance(error, OSError) or error.errno == errno.EINVAL
