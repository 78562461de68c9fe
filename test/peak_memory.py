"""Memory of a program that a test starts."""

from __future__ import annotations

#: To be put before its code: the most that it has had so far, bytes. ru_maxrss would not do: it is at least what the
#: process had that started it, and a process of tests is large.
PEAK_BYTES = r'''
def peak_bytes():
    with open('/proc/self/status') as status:
        return 1024 * int(next(line.split()[1] for line in status if line.startswith('VmHWM:')))
'''
