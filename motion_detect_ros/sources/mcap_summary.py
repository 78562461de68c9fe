"""What the end of an MCAP file says of the file: what is in it, and where."""

from __future__ import annotations

import errno
import zlib
from collections.abc import Iterator
from dataclasses import dataclass
from itertools import pairwise
from os import SEEK_END
from typing import IO

from mcap.reader import FOOTER_SIZE, make_reader
from mcap.records import Footer
from mcap.stream_reader import MAGIC_SIZE, StreamReader
from mcap.summary import Summary

#: Read at once for the checksum.
_BLOCK_BYTES = 1 << 20
#: Of the checksum itself, the last field of the footer.
_CRC_BYTES = 4


class SummaryError(ValueError):
    """The summary has another checksum than it should."""


@dataclass(frozen=True)
class Section:
    """Bytes ``start`` to ``end`` (exclusive) of a file. ``chunk``: they are one; else records between chunks."""

    start: int
    end: int
    chunk: bool


def read_summary(stream: IO[bytes]) -> Summary | None:
    """None where the writer made none.

    Raises: SummaryError for a wrong checksum; whatever mcap raises where the file ends otherwise than it should.
    """
    _check(stream)
    stream.seek(0)
    return make_reader(stream).get_summary()


def sections_of(summary: Summary | None, size: int) -> Iterator[Section]:
    """A file of ``size`` bytes in the order of its bytes; all of it is one section where no chunk is known."""
    indexes = sorted(summary.chunk_indexes, key=lambda index: index.chunk_start_offset) if summary else []
    chunks = [(index.chunk_start_offset, index.chunk_start_offset + index.chunk_length) for index in indexes]
    for (_, last), (start, end) in pairwise([(0, 0), *chunks, (size, size)]):
        if last < start:
            yield Section(last, start, chunk=False)
        if start < end:
            yield Section(start, end, chunk=True)


def is_damage(error: Exception) -> bool:
    """All but trouble with the medium: the library raises anything on bytes that are not what they should be.

    EINVAL is what it gets for jumping to before the start of a file that is too short.
    """
    return not isinstance(error, OSError) or error.errno == errno.EINVAL


def _check(stream: IO[bytes]) -> None:
    """The checksum is that of all bytes from the beginning of the summary up to itself; 0 = not made."""
    end = stream.seek(-(FOOTER_SIZE + MAGIC_SIZE), SEEK_END) + FOOTER_SIZE - _CRC_BYTES
    footer = next(StreamReader(stream, skip_magic=True).records)
    if not isinstance(footer, Footer) or not footer.summary_start or not footer.summary_crc:
        return  # the reader says what is wrong, or there is nothing to check
    found, left = 0, end - stream.seek(footer.summary_start)
    while left > 0 and (block := stream.read(min(left, _BLOCK_BYTES))):
        found, left = zlib.crc32(block, found), left - len(block)
    if found != footer.summary_crc:
        raise SummaryError(f'checksum of the summary: expected {footer.summary_crc}, got {found}')
