"""A DDS domain for a run's own nodes, so that runs on one machine do not hear each other."""

from __future__ import annotations

import fcntl
import os
import tempfile
from functools import cache
from pathlib import Path

#: DDS domains that plain Linux port ranges allow.
DOMAINS = range(1, 101)


def own_domain() -> int:
    """The user's ROS_DOMAIN_ID, or one that no other process of this machine has got here; the same all the time."""
    chosen = os.environ.get('ROS_DOMAIN_ID')
    return int(chosen) if chosen else _reserved(os.getpid())


@cache
def _reserved(pid: int) -> int:
    """The first free domain from one on that depends on the process; that one where none can be reserved.

    It stays locked as long as the process lives: the file is left open on purpose.
    """
    for domain in (DOMAINS[(pid + number) % len(DOMAINS)] for number in range(len(DOMAINS))):
        if _lock(Path(tempfile.gettempdir()) / f'motion_detect_ros-{os.getuid()}-domain-{domain}.lock'):
            return domain
    return DOMAINS[pid % len(DOMAINS)]


def _lock(path: Path) -> bool:
    """Whether nobody has the file locked and this process has now."""
    try:
        file = os.open(path, os.O_RDWR | os.O_CREAT | os.O_NOFOLLOW, 0o600)
    except OSError:
        return False
    try:
        fcntl.flock(file, fcntl.LOCK_EX | fcntl.LOCK_NB)
    except OSError:
        os.close(file)
        return False
    return True
