"""What the processes of a graph need from their environment to pass large images fast (docs/performance.md)."""

from __future__ import annotations

import contextlib
import ctypes
import os
import sys

from motion_detect_ros.presets import find_config

PROFILE_VARIABLE = 'FASTRTPS_DEFAULT_PROFILES_FILE'
PROFILE_NAME = 'fastdds_profile.xml'
#: glibc: keep freed large buffers instead of giving their pages back after every message.
MALLOC = {'MALLOC_MMAP_THRESHOLD_': 268435456, 'MALLOC_TRIM_THRESHOLD_': 536870912, 'MALLOC_TOP_PAD_': 67108864}
#: The same by mallopt(3): M_MMAP_THRESHOLD, M_TRIM_THRESHOLD, M_TOP_PAD.
MALLOPT = {-3: 268435456, -1: 536870912, -2: 67108864}


def environment() -> dict[str, str]:
    """The process environment with transport profile and allocator settings; the user's own values win."""
    ours = {PROFILE_VARIABLE: str(find_config(PROFILE_NAME)),
            **{name: str(value) for name, value in MALLOC.items()}}
    return {**ours, **os.environ}


def profile_set() -> bool:
    """Whether some Fast DDS profile is in force."""
    return bool(os.environ.get(PROFILE_VARIABLE))


def tune_malloc() -> None:
    """The allocator settings for this process; does nothing where there is no glibc."""
    if sys.platform != 'linux':
        return
    with contextlib.suppress(OSError, AttributeError):
        mallopt = ctypes.CDLL(None).mallopt
        for option, value in MALLOPT.items():
            mallopt(option, value)
