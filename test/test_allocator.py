"""What the settings of glibc's allocator keep, and what is given back all the same."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

import pytest

MEGABYTES = 100
PROGRAM = f"""
import os
from pathlib import Path

from motion_detect_ros.allocator import give_back, tune_malloc


def resident_mb():
    return int(Path('/proc/self/statm').read_text().split()[1]) * os.sysconf('SC_PAGE_SIZE') / 1e6


tune_malloc()
before = resident_mb()
blocks = [bytes(10_000) for _ in range({MEGABYTES} * 100)]
del blocks[:-1]  # the last one keeps the heap from shrinking
print(resident_mb() - before)
give_back()
print(resident_mb() - before)
"""


@pytest.mark.skipif(not Path('/proc/self/statm').exists(), reason='needs /proc')
def test_what_was_freed_stays_until_it_is_given_back() -> None:
    done = subprocess.run([sys.executable, '-c', PROGRAM], capture_output=True, text=True, check=True)
    kept, left = map(float, done.stdout.split())
    assert kept > 0.9 * MEGABYTES
    assert left < 0.2 * MEGABYTES


#: Threads that live side by side, and use as much memory one after the other.
IN_TURN = f"""
import threading

{PROGRAM[:PROGRAM.index('blocks')]}
turn = threading.Barrier(6)


def use(own):
    for each in range(6):
        turn.wait()
        if each == own:
            blocks = [bytes(10_000) for _ in range(2000)]
            del blocks[:-1]


users = [threading.Thread(target=use, args=(own,)) for own in range(6)]
for user in users:
    user.start()
for user in users:
    user.join()
print(resident_mb() - before)
"""


@pytest.mark.skipif(not Path('/proc/self/statm').exists(), reason='needs /proc')
def test_what_one_thread_has_freed_another_uses() -> None:
    """20 MB each: 120 if every thread kept its own."""
    done = subprocess.run([sys.executable, '-c', IN_TURN], capture_output=True, text=True, check=True)
    assert float(done.stdout) < 70.0
