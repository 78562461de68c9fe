"""What one pass over an MCAP file could not read, and whether later frames still have their numbers."""

from __future__ import annotations

from collections.abc import Iterator


class Losses:
    """Counts as the pass goes on.

    An unreadable chunk is followed by records that list its messages; those that are listed keep their places. Where
    the list is missing too, all that comes later stands further in front than it was recorded.
    """

    def __init__(self) -> None:
        self._chunks = self._places = 0
        self._read = self._listed = self._missing = self._announced = 0
        self._shifted = False
        self._chunk_lost = self._chunk_listed = False

    def next_chunk(self, lost: bool = False) -> None:
        """What comes from now on belongs to the next chunk, which can be read or not."""
        self._shifted |= self._chunk_lost and not self._chunk_listed
        self._chunk_lost, self._chunk_listed = lost, False
        self._chunks += lost

    def add_place(self) -> None:
        """Bytes between chunks are unreadable."""
        self._places += 1

    def add_hole(self) -> None:
        """Bytes are unreadable, and nothing tells what messages were in them."""
        self._places += 1
        self._shifted = True

    def add_read(self) -> None:
        """A message of the wanted topics was read."""
        self._read += 1

    def list_lost(self, count: int | None) -> None:
        """So many messages of the wanted topics were in the lost chunk; None: of an unknown topic."""
        self._chunk_listed = True
        self._shifted |= count is None
        self._listed += count or 0

    @property
    def chunk_lost(self) -> bool:
        """Whether the present chunk could not be read."""
        return self._chunk_lost

    def end(self, announced: int | None) -> None:
        """The pass is over; ``announced``: messages of the wanted topics by the statistics of the file."""
        if announced is not None:
            self._announced, self._missing = announced, max(0, announced - self._read)
            self._shifted |= self._missing > self._listed

    def faults(self) -> Iterator[str]:
        """In words."""
        if self._chunks:
            yield f'{self._chunks} unreadable chunk(s) skipped'
        if self._places:
            yield f'unreadable bytes in {self._places} place(s)'
        if self._missing:
            yield f'{self._missing} of {self._announced} messages missing'
        if self._shifted:
            yield 'numbers of the frames after them are too small'
