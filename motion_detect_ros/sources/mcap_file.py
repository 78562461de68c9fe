"""MCAP files, read from front to back so that a damaged one still gives every intact chunk.

Format: MCAP specification, https://mcap.dev/spec (chunks of records, each with a checksum; summary at the end).
"""

from __future__ import annotations

from collections import deque
from collections.abc import Iterable, Iterator
from pathlib import Path
from typing import IO

from mcap.records import Channel, Chunk, DataEnd, McapRecord, Message, MessageIndex, Schema
from mcap.stream_reader import StreamReader, breakup_chunk
from mcap.summary import Summary
from rosbags.typesys.msg import normalize_msgtype

from motion_detect_ros.sources.mcap_losses import Losses
from motion_detect_ros.sources.mcap_recovery import next_chunk
from motion_detect_ros.sources.mcap_summary import Section, SummaryError, is_damage, read_summary, sections_of
from motion_detect_ros.sources.messages import ROS1, from_ros1, ros1_encoding
from motion_detect_ros.sources.raw import CDR, LOST, RawMessage, TopicInfo, merged

MAGIC = b'\x89MCAP0\r\n'

#: A chunk that announces more than this is damaged; recorders write some megabytes.
MAX_CHUNK_BYTES = 1 << 30

_CUT_OFF = 'the end is missing (recording was cut off)'
_BAD_SUMMARY = 'the summary at the end is damaged'


class McapFile:
    """One MCAP file as ``BagStorage``.

    Messages come chunk by chunk in file order, sorted by log time within a chunk: what a recorder writes is in
    order of time then, and memory stays at one chunk. After bytes that make no sense it goes on with the next chunk
    that the summary names; where there is no summary, with the next bytes that look like one.
    """

    def __init__(self, path: Path) -> None:
        """Reads the summary; a file that ends without one is ``damaged`` but readable."""
        self._path = path
        self._schemas: dict[int, Schema] = {}
        self._channels: dict[int, Channel] = {}
        self._summary: Summary | None = None
        self._topics: tuple[TopicInfo, ...] | None = None
        self._end_fault = self._read_summary()
        self._losses = Losses()

    @property
    def damaged(self) -> str | None:
        """What is wrong with the end, and what could not be read so far."""
        faults = [*filter(None, (self._end_fault,)), *self._losses.faults()]
        return f'{self._path.name}: {", ".join(faults)}' if faults else None

    @property
    def topics(self) -> tuple[TopicInfo, ...]:
        """From the summary, or by reading the whole file where that is missing."""
        if self._topics is None:
            self._topics = self._summary_topics() or self._counted_topics()
        return self._topics

    def messages(self, topics: frozenset[str] | None = None) -> Iterator[RawMessage]:
        """Every message, ``LOST`` where only that it was recorded is known; what is missing is added to ``damaged``.

        Nothing is read where the summary says that there are none of ``topics``.
        """
        self._losses = Losses()
        summary = self._summary_topics() if topics is not None else ()
        if summary and not any(topic.count and topic.name in topics for topic in summary):  # type: ignore[operator]
            return
        lost: list[RawMessage] = []
        with self._path.open('rb') as stream:
            for record in self._records(stream):
                if isinstance(record, MessageIndex):
                    lost += self._lost_messages(record, topics)
                    continue
                yield from sorted(lost, key=_by_time)
                lost.clear()
                if isinstance(record, Chunk):
                    yield from self._chunk_messages(record, topics)
                else:
                    yield from self._learn((record,), topics)
        yield from sorted(lost, key=_by_time)
        self._losses.end(self._announced(topics))

    def close(self) -> None:
        """Nothing stays open between calls."""

    def _records(self, stream: IO[bytes]) -> Iterator[McapRecord]:
        """Records of all sections, of each up to where it stops making sense, and from where it does again."""
        size = self._path.stat().st_size
        sections = deque(sections_of(self._summary, size))
        while sections:
            section = sections.popleft()
            place = stream.seek(section.start)
            try:
                for record in _records_of(stream, section):
                    end = stream.tell()
                    yield record
                    if not (isinstance(record, Chunk) and self._losses.chunk_lost):  # else its length may be another
                        place = end
            except Exception as error:
                if not is_damage(error):
                    raise
                if section.chunk:
                    self._losses.next_chunk(lost=True)
                elif self._summary is None:
                    sections.extend(self._rest(stream, place + 1, size))
                elif stream.tell() <= section.end:  # else it has read on, into what is a section by itself
                    self._losses.add_place()

    def _rest(self, stream: IO[bytes], start: int, size: int) -> Iterator[Section]:
        """What follows from the next chunk after ``start`` on, found by its looks; empty where there is none."""
        place = next_chunk(stream, start, size)
        if place is None:
            self._end_fault = self._end_fault or _CUT_OFF
        else:
            self._losses.add_hole()
            yield Section(place, size, chunk=False)

    def _chunk_messages(self, chunk: Chunk, topics: frozenset[str] | None) -> list[RawMessage]:
        try:
            if chunk.uncompressed_size > MAX_CHUNK_BYTES:
                raise ValueError(f'expected at most {MAX_CHUNK_BYTES} bytes, got {chunk.uncompressed_size}')
            records = breakup_chunk(chunk, validate_crc=True)
        except Exception as error:
            if not is_damage(error):
                raise
            self._losses.next_chunk(lost=True)
            return []
        self._losses.next_chunk()
        return sorted(self._learn(records, topics), key=_by_time)

    def _lost_messages(self, index: MessageIndex, topics: frozenset[str] | None) -> Iterator[RawMessage]:
        """Those that were in an unreadable chunk, by the record behind it that lists those of a channel."""
        if not self._losses.chunk_lost:
            return
        channel = self._channels.get(index.channel_id)
        wanted = channel is not None and (topics is None or channel.topic in topics)
        self._losses.list_lost(None if channel is None else len(index.records) * wanted)
        if channel is not None and wanted:
            for log_stamp_ns, _ in index.records:
                yield RawMessage(channel.topic, self._msgtype(channel), log_stamp_ns, LOST, self._encoding(channel))

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
                    self._losses.add_read()
                    msgtype = self._msgtype(channel)
                    data = from_ros1(record.data, msgtype) if channel.message_encoding == ROS1 else record.data
                    yield RawMessage(channel.topic, msgtype, record.log_time, data, self._encoding(channel))

    def _msgtype(self, channel: Channel) -> str:
        schema = self._schemas.get(channel.schema_id)
        if schema is None:
            return ''
        return normalize_msgtype(schema.name) if channel.message_encoding == ROS1 else schema.name

    def _encoding(self, channel: Channel) -> str:
        """Of its messages as they are given; CDR where the file does not tell."""
        if channel.message_encoding == ROS1:
            return ros1_encoding(self._msgtype(channel))
        return channel.message_encoding or CDR

    def _read_summary(self) -> str:
        """Take channels, counts and places from the end of the file; what is wrong with it, empty for nothing."""
        try:
            with self._path.open('rb') as stream:
                summary = read_summary(stream)
        except SummaryError:
            return _BAD_SUMMARY
        except Exception as error:
            if not is_damage(error):
                raise
            return _CUT_OFF
        if summary is not None:
            self._schemas.update(summary.schemas)
            self._channels.update(summary.channels)
            self._summary = summary
        return ''

    def _counts(self) -> dict[int, int] | None:
        """Messages of each channel by the statistics; None where the file does not tell."""
        statistics = self._summary.statistics if self._summary else None
        if statistics is None or (statistics.message_count and not statistics.channel_message_counts):
            return None  # the format allows both
        return statistics.channel_message_counts

    def _announced(self, topics: frozenset[str] | None) -> int | None:
        counts = self._counts()
        if counts is None:
            return None
        return sum(counts.get(number, 0) for number, channel in self._channels.items()
                   if topics is None or channel.topic in topics)

    def _summary_topics(self) -> tuple[TopicInfo, ...]:
        counts = self._counts()
        if counts is None:
            return ()
        return merged(TopicInfo(channel.topic, self._msgtype(channel), counts.get(number, 0), self._encoding(channel))
                      for number, channel in self._channels.items())

    def _counted_topics(self) -> tuple[TopicInfo, ...]:
        return merged(TopicInfo(message.topic, message.msgtype, 1, message.encoding) for message in self.messages())


def _by_time(message: RawMessage) -> int:
    return message.log_stamp_ns


def _records_of(stream: IO[bytes], section: Section) -> Iterator[McapRecord]:
    """Those of a section, from its first byte on. Raises: anything where they are not what they should be."""
    reader = StreamReader(stream, skip_magic=section.start > 0, emit_chunks=True,
                          record_size_limit=section.end - section.start)
    for record in reader.records:
        place = stream.tell()
        if section.chunk and not (isinstance(record, Chunk) and place == section.end):
            raise ValueError(f'expected a chunk from byte {section.start} to {section.end}')
        if place > section.end:
            return
        yield record
        if place == section.end or isinstance(record, DataEnd):
            return
