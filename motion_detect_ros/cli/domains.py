"""A DDS domain for a run's own nodes, so that runs on one machine do not hear each other."""

from __future__ import annotations

import fcntl
import os
import tempfile
from functools import cache
from pathlib import Path

from motion_detect_ros.core.errors import ConfigError

#: DDS domains that plain Linux port ranges allow.
DOMAINS = range(1, 101)
#: The last one whose ports there are.
LAST_DOMAIN = 232
#: Domain that this process has reserved -> descriptor of the file that it has locked.
_LOCKS: dict[int, int] = {}


def own_domain() -> int:
    """The user's ROS_DOMAIN_ID, or one that no other process of this machine has got here; the same all the time.

    Raises: ConfigError where the user's is none.
    """
    chosen = os.environ.get('ROS_DOMAIN_ID')
    if not chosen:
        return _reserved(os.getpid())
    if not chosen.strip().isdecimal() or int(chosen) > LAST_DOMAIN:
        raise ConfigError(f'ROS_DOMAIN_ID: expected a whole number from 0 to {LAST_DOMAIN}, got {chosen}')
    return int(chosen)


def lock_of(domain: int) -> tuple[int, ...]:
    """What processes started in a domain of ours are to inherit (``pass_fds``): it is theirs as long as one is left.

    Else a run that is killed gives its domain to the next one, which then hears the nodes left of it. Empty for a
    domain that the user chose.
    """
    return (_LOCKS[domain],) if domain in _LOCKS else ()


@cache
def _reserved(pid: int) -> int:
    """The first free domain from one on that depends on the process; that one where none can be reserved.

    It stays locked as long as the process lives, and who has inherited its lock: the file is left open on purpose.
    """
    for domain in (DOMAINS[(pid + number) % len(DOMAINS)] for number in range(len(DOMAINS))):
        lock = _lock(Path(tempfile.gettempdir()) / f'motion_detect_ros-{os.getuid()}-domain-{domain}.lock')
        if lock is not None:
            _LOCKS[domain] = lock
            return domain
    return DOMAINS[pid % len(DOMAINS)]


def _lock(path: Path) -> int | None:
    """The descriptor of the file, which is locked now; None where another process has locked it."""
    try:
        file = os.open(path, os.O_RDWR | os.O_CREAT | os.O_NOFOLLOW, 0o600)
    except OSError:
        return None
    try:
        fcntl.flock(file, fcntl.LOCK_EX | fcntl.LOCK_NB)
    except OSError:
        os.close(file)
        return None
    return file
