"""Words that are no scheduler: one line, and the program ends."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

import pytest
from batch_flights import PATIENCE_S, write_flight

EXPECTED = 'expected the address of a Dask scheduler (tcp://HOST:8786) or the file that it wrote'
NO_ADDRESS = 'expected the file that a Dask scheduler wrote, got one without its address'


@pytest.mark.parametrize(('word', 'content', 'reason'), [
    ('nofile.json', None, f'{EXPECTED}; there is no such file, and an address has a port'),
    ('127.0.0.1', None, f'{EXPECTED}; there is no such file, and an address has a port'),
    ('http://127.0.0.1:8786', None, f"{EXPECTED}: unknown address scheme 'http' (known schemes: "),
    ('tls://127.0.0.1:8786', None, f'{EXPECTED}: TLS expects a `ssl_context` argument'),
    ('summary.json', '{"input": "a.mcap"}', NO_ADDRESS),
    ('list.json', '[]', NO_ADDRESS),
    ('number.json', '{"address": 7}', NO_ADDRESS),
    ('text.json', 'no JSON', NO_ADDRESS),
    ('port.json', '{"address": "tcp://127.0.0.1"}', f"{EXPECTED}: missing port number in address '127.0.0.1'"),
])
def test_what_is_no_scheduler_is_one_line_and_the_end(tmp_path: Path, word: str, content: str | None, reason: str):
    """As a process: a client that is left half made shows only when Python ends."""
    pytest.importorskip('distributed', reason='Dask is an extra')
    if content is not None:
        (tmp_path / word).write_text(content)
    bag = write_flight(tmp_path / 'a.mcap', frames=2)
    words = ['replay', '--no-report', str(bag), '-o', 'out', '--scheduler', word]
    done = subprocess.run([sys.executable, '-m', 'motion_detect_ros', *words], cwd=tmp_path, capture_output=True,
                          text=True, timeout=PATIENCE_S, check=False)
    assert (done.returncode, done.stdout) == (2, '')
    assert done.stderr.startswith(f'error: --scheduler {word}: {reason}')
    assert done.stderr.count('\n') == 1, done.stderr
