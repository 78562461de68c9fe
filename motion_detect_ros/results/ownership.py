"""Who writes a folder: one process at a time, by a lock that ends with it, however that ends."""

from __future__ import annotations

import fcntl
import os
import platform
import uuid
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from pathlib import Path

from motion_detect_ros.core.errors import SourceError
from motion_detect_ros.sources.part_file import locked_file

#: Holds who writes; a killed process leaves it behind, unlocked.
LOCK_NAME = '.writing'


class BusyError(SourceError):
    """Another process writes the folder."""


@dataclass(frozen=True)
class Owner:
    """A process that writes a folder; ``name``: what it left in its lock, unlike that of any other."""

    folder: Path
    name: str

    def holds(self) -> bool:
        """Whether the folder is still its own, which without locks is the last one's to come."""
        return _written_by(self.folder) == self.name

    def check(self) -> None:
        """Raises: BusyError where the folder is another one's by now."""
        if not self.holds():
            raise _busy(self.folder)


@contextmanager
def owned(folder: Path) -> Iterator[Owner]:
    """Be the only one that writes into an existing folder.

    ``flock`` holds between machines too, on NFS; where a file system has no locks, or none that other machines see,
    ``Owner.check`` says at the end whether another one has come.
    Raises: BusyError where another process writes it, SourceError where it cannot be written.
    """
    owner = Owner(folder, f'process {os.getpid()} on {platform.node()} {uuid.uuid4().hex}')
    try:
        file = locked_file(folder / LOCK_NAME, os.O_NOFOLLOW)
    except BlockingIOError:
        raise _busy(folder) from None
    except OSError as error:
        raise _unwritable(folder, error) from None
    try:
        _sign(file, owner)
        yield owner
    finally:
        if owner.holds():
            with suppress(OSError):
                (folder / LOCK_NAME).unlink()
        os.close(file)


def is_owned(folder: Path) -> bool:
    """Whether a living process writes the folder, or nobody can say."""
    try:
        file = os.open(folder / LOCK_NAME, os.O_RDWR | os.O_NOFOLLOW)
    except OSError:
        return False
    try:
        fcntl.flock(file, fcntl.LOCK_EX | fcntl.LOCK_NB)
    except OSError:
        return True
    finally:
        os.close(file)
    return False


def _sign(file: int, owner: Owner) -> None:
    """Raises: SourceError where there is no room for it; the lock is taken away then."""
    try:
        os.ftruncate(file, 0)
        os.pwrite(file, owner.name.encode(), 0)
    except OSError as error:
        with suppress(OSError):
            (owner.folder / LOCK_NAME).unlink()
        raise _unwritable(owner.folder, error) from None


def _unwritable(folder: Path, error: OSError) -> SourceError:
    return SourceError(f'{folder}: cannot be written: {error.strerror}')


def _busy(folder: Path) -> BusyError:
    who = _written_by(folder).rpartition(' ')[0]
    return BusyError(f'{folder}: is being written by another process' + (f' ({who})' if who else ''))


def _written_by(folder: Path) -> str:
    try:
        return (folder / LOCK_NAME).read_text(encoding='utf-8', errors='replace')
    except OSError:
        return ''
