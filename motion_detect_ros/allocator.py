"""glibc's allocator, told to keep the buffers of images: giving them back after every frame takes milliseconds.

In two heaps, not in one for each thread, which would keep the largest buffers that it ever had.
"""

from __future__ import annotations

import contextlib
import ctypes
import sys

#: For processes that are yet to start.
VARIABLES = {'MALLOC_MMAP_THRESHOLD_': 268435456, 'MALLOC_TRIM_THRESHOLD_': 536870912, 'MALLOC_TOP_PAD_': 67108864,
             'MALLOC_ARENA_MAX': 2}
#: The same by mallopt(3): M_MMAP_THRESHOLD, M_TRIM_THRESHOLD, M_TOP_PAD, M_ARENA_MAX.
_MALLOPT = {-3: 268435456, -1: 536870912, -2: 67108864, -8: 2}


def tune_malloc() -> None:
    """The settings for this process; does nothing where there is no glibc."""
    for option, value in _MALLOPT.items():
        _call('mallopt', option, value)


def give_back() -> None:
    """What the start of a process has freed, once: the settings above have it kept. Nothing where there is no glibc."""
    _call('malloc_trim', 0)


def _call(function: str, *values: int) -> None:
    """A function of glibc, where there is one."""
    if sys.platform != 'linux':
        return
    with contextlib.suppress(OSError, AttributeError):
        getattr(ctypes.CDLL(None), function)(*values)
