"""Shared memory that killed Fast DDS processes leave behind: their segments, and the ports that they read."""

from __future__ import annotations

import fcntl
import mmap
import re
import struct
import time
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path

FOLDER = Path('/dev/shm')
#: The files that processes keep locked as long as they live, of a segment and of a port that they read.
_SEGMENT, _PORT = re.compile(r'fastrtps_[0-9a-f]{16}_el'), re.compile(r'fastrtps_port(\d+)_el')
#: A younger one may be about to be locked, seconds.
MIN_AGE_S = 5.0
#: Of a port, somewhere in its first bytes: number, readers, milliseconds after which a reader that does not answer is
#: taken for dead, a third of them, places for messages, readers that wait, flags (``PortNode``, Fast DDS 2.14).
_HEAD_BYTES, _NODE = 4096, struct.Struct('=7I')
#: The flags, and the one without which everybody opens the port anew.
_FLAGS, _IS_OK = 0b111, 0b001


def remove_dead_segments(folder: Path = FOLDER) -> int:
    """Removes the segments of processes that are dead, as ``fastdds shm clean`` does; returns how many.

    They hold 35 MB each with the profile of the package. The lock of a file is that of its process, whatever program it
    runs and in whichever container; those of other users are left alone.
    """
    return sum(_remove_if_dead(lock) for lock in _files(folder) if _SEGMENT.fullmatch(lock.name))


def give_up_dead_ports(folder: Path = FOLDER) -> int:
    """Marks the ports that dead processes have read as broken, as Fast DDS does; returns how many it had not.

    It goes by the reader's last words, that it waits for a message or reads one. One that is killed in between seems
    well for good: others keep the port open, and what they send to the process that gets the port after it, the next
    one that starts as a rule, is lost. The two never find each other.
    """
    return sum(_give_up_if_dead(lock, int(port[1])) for lock in _files(folder) if (port := _PORT.fullmatch(lock.name)))


def _files(folder: Path) -> list[Path]:
    try:
        return [*folder.iterdir()]
    except OSError:  # no such folder on this system, or not for us
        return []


@contextmanager
def _dead(lock: Path) -> Iterator[bool]:
    """Whether the process that locked the file is dead; then nobody else locks it meanwhile."""
    with lock.open('rb') as stream:
        if old := time.time() - lock.stat().st_mtime >= MIN_AGE_S:
            fcntl.flock(stream, fcntl.LOCK_EX | fcntl.LOCK_NB)
        yield old


def _remove_if_dead(lock: Path) -> bool:
    with suppress(OSError), _dead(lock) as dead:  # locked, another user's, or gone by now
        if dead:
            _locked(lock).unlink(missing_ok=True)
            lock.unlink()
        return dead
    return False


def _give_up_if_dead(lock: Path, port: int) -> bool:
    # A port that is broken is not locked, not even for a moment: somebody may be about to make it anew.
    with suppress(OSError, ValueError), _locked(lock).open('r+b') as file, \
            mmap.mmap(file.fileno(), _HEAD_BYTES) as head:
        place = _flags_of(head, port)
        if place is not None and head[place] & _IS_OK:
            with _dead(lock) as dead:
                if dead:
                    head[place] &= ~_IS_OK
                return dead
    return False


def _locked(lock: Path) -> Path:
    return lock.with_name(lock.name.removesuffix('_el'))


def _flags_of(head: mmap.mmap, port: int) -> int | None:
    """Where the byte of the flags is; None where this is not the port that we know, or not in one place only."""
    found, start, wanted = [], -1, struct.pack('=I', port)
    while 0 <= (start := head.find(wanted, start + 1)) <= _HEAD_BYTES - _NODE.size:
        _, _, dead_ms, third_ms, _, _, flags = _NODE.unpack_from(head, start)
        if not start % 4 and dead_ms and third_ms == dead_ms // 3 and not flags & ~_FLAGS:
            found.append(start + _NODE.size - 4)
    return found[0] if len(found) == 1 else None
