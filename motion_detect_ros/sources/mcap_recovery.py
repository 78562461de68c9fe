"""Where an MCAP file makes sense again, found by what its bytes look like, as nothing else says it.

Format: MCAP specification, https://mcap.dev/spec (Chunk: kind 0x06, length, two times, size and checksum of what is in
it, name of the compression, length of the records, records).
"""

from __future__ import annotations

import re
from typing import IO

#: Read at once.
_BLOCK_BYTES = 1 << 20
#: The lengths are below 2^40 and fit each other, the name is one of three: no other bytes look like this.
_CHUNK = re.compile(
    rb'\x06(.{5}\0{3})(.{8})(.{8}).{5}\0{3}.{4}(?:\0{4}|\x03\0{3}lz4|\x04\0{3}zstd)(.{5}\0{3})', re.DOTALL)
#: The longest of them; kind and length of a record.
_LONGEST, _HEAD = 53, 9


def next_chunk(stream: IO[bytes], start: int, size: int) -> int | None:
    """Where the next whole chunk of a file of ``size`` bytes begins, from ``start`` on; None where there is none."""
    place, rest = start, b''
    stream.seek(start)
    while block := stream.read(_BLOCK_BYTES):
        data = rest + block
        for found in _overlapping(data):
            length, first, last, records = (int.from_bytes(field, 'little') for field in found.groups())
            at = place - len(rest) + found.start()
            fits = length == found.end() - found.start() - _HEAD + records and at + _HEAD + length <= size
            if fits and first <= last:
                return at
        place += len(block)
        rest = data[-_LONGEST + 1:]
    return None


def _overlapping(data: bytes) -> list[re.Match[bytes]]:
    """All matches, those that begin inside of another one too."""
    matches, place = [], 0
    while found := _CHUNK.search(data, place):
        matches.append(found)
        place = found.start() + 1
    return matches
