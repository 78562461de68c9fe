"""Shared memory that killed Fast DDS processes leave behind: 35 MB each with the profile of the package."""

from __future__ import annotations

import contextlib
import fcntl
import re
import time
from pathlib import Path

FOLDER = Path('/dev/shm')
#: A segment and the file that its process keeps locked as long as it lives.
_LOCK = re.compile(r'fastrtps_[0-9a-f]{16}_el')
#: A younger one may be about to be locked, seconds.
MIN_AGE_S = 5.0


def remove_dead_segments(folder: Path = FOLDER) -> int:
    """Removes the segments of processes that are dead, as ``fastdds shm clean`` does; returns how many.

    The lock of a file is that of its process, whatever program it runs and in whichever container; those of other
    users are left alone. Ports are left too: they hold a few kB and Fast DDS uses them again.
    """
    try:
        locks = [path for path in folder.iterdir() if _LOCK.fullmatch(path.name)]
    except OSError:  # no such folder on this system, or not for us
        return 0
    return sum(map(_remove_if_dead, locks))


def _remove_if_dead(lock: Path) -> bool:
    with contextlib.suppress(OSError), lock.open('rb') as stream:  # locked, another user's, or gone by now
        if time.time() - lock.stat().st_mtime < MIN_AGE_S:
            return False
        fcntl.flock(stream, fcntl.LOCK_EX | fcntl.LOCK_NB)
        lock.with_name(lock.name.removesuffix('_el')).unlink(missing_ok=True)
        lock.unlink()
        return True
    return False
