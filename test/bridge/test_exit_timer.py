"""Processes that would not end by themselves."""

import subprocess
import sys
import time

import pytest

#: Sleeps like a C call that gives the interpreter away, and like one that keeps it.
SLEEPS = {'given away': 'time.sleep(60)', 'kept': 'ctypes.PyDLL(None).sleep(60)'}
SCRIPT = '''
import ctypes, time
from motion_detect_ros.bridge.exit_timer import exits_after
print(time.monotonic(), flush=True)
with exits_after({seconds}, {code}):
    {block}
print('on', flush=True)
time.sleep(1.0)
'''


def ended(seconds: float, code: int, block: str) -> tuple[int, str, float]:
    """Exit code, what is printed after the block, seconds since the block began."""
    process = subprocess.run([sys.executable, '-c', SCRIPT.format(seconds=seconds, code=code, block=block)],
                             capture_output=True, text=True, check=False, timeout=120)
    assert process.stderr == ''
    began, printed = process.stdout.split('\n', 1)
    return process.returncode, printed, time.monotonic() - float(began)


@pytest.mark.parametrize('sleep', SLEEPS)
@pytest.mark.parametrize('code', [0, 1, 255])
def test_the_process_ends_with_the_code_asked_for(sleep, code):
    returned, printed, took_s = ended(0.3, code, SLEEPS[sleep])
    assert (returned, printed) == (code, '')
    assert 0.3 < took_s < 50.0


def test_a_block_that_ends_in_time_has_no_end():
    assert ended(0.5, 3, 'pass')[:2] == (0, 'on\n')
