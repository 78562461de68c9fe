"""A second SIGTERM while files are being closed changes nothing."""

from __future__ import annotations

import subprocess
import sys

import pytest
from batch_flights import PATIENCE_S

#: The handler of a process, and a closing of files in whose middle the signal comes again.
_TWICE = """
import os, signal
from motion_detect_ros.{module} import {handler}
signal.signal(signal.SIGTERM, {handler})
try:
    os.kill(os.getpid(), signal.SIGTERM)
except KeyboardInterrupt:
    os.kill(os.getpid(), signal.SIGTERM)
    print('closed')
"""


@pytest.mark.parametrize(('module', 'handler'), [('cli.batch.processes', '_interrupt'), ('__main__', '_terminate')])
def test_a_second_signal_does_not_end_the_closing_of_files(module: str, handler: str):
    done = subprocess.run([sys.executable, '-c', _TWICE.format(module=module, handler=handler)], capture_output=True,
                          text=True, timeout=PATIENCE_S, check=False)
    assert (done.returncode, done.stdout, done.stderr) == (0, 'closed\n', '')
