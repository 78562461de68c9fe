"""Signals that end a run: files are closed, and a second SIGTERM meanwhile changes nothing."""

from __future__ import annotations

import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest
from batch_flights import PATIENCE_S, write_flight

from motion_detect_ros.sources.bags import BagReader

pytestmark = pytest.mark.messages

#: A closing of files in whose middle a signal comes again.
_TWICE = """
import os, signal
from motion_detect_ros.cli.interrupts import interrupt_once
interrupt_once(signal.SIGTERM, signal.SIGHUP)
try:
    os.kill(os.getpid(), signal.{first})
except KeyboardInterrupt:
    os.kill(os.getpid(), signal.{second})
    print('closed')
"""

#: A process of our own that is started when a signal comes.
_HELD = """
import os, signal
from motion_detect_ros.cli.interrupts import held_back, interrupt_once
interrupt_once(signal.SIGTERM, signal.SIGHUP)
try:
    with held_back():
        os.kill(os.getpid(), signal.{first})
        print('made')
    print('not interrupted')
except KeyboardInterrupt:
    print('interrupted')
"""


@pytest.mark.parametrize(('first', 'second'), [
    ('SIGTERM', 'SIGTERM'), ('SIGTERM', 'SIGHUP'), ('SIGHUP', 'SIGTERM'), ('SIGHUP', 'SIGHUP')])
def test_a_second_signal_does_not_end_the_closing_of_files(first: str, second: str):
    done = subprocess.run([sys.executable, '-c', _TWICE.format(first=first, second=second)], capture_output=True,
                          text=True, timeout=PATIENCE_S, check=False)
    assert (done.returncode, done.stdout, done.stderr) == (0, 'closed\n', '')


@pytest.mark.parametrize('first', ['SIGINT', 'SIGTERM', 'SIGHUP'])
def test_a_signal_waits_until_what_is_made_is_known(first: str):
    done = subprocess.run([sys.executable, '-c', _HELD.format(first=first)], capture_output=True, text=True,
                          timeout=PATIENCE_S, check=False)
    assert (done.returncode, done.stdout, done.stderr) == (0, 'made\ninterrupted\n', '')


def test_a_terminal_that_is_closed_closes_the_files(tmp_path: Path):
    bag, out = write_flight(tmp_path / 'a.mcap', frames=300), tmp_path / 'out'
    command = [sys.executable, '-m', 'motion_detect_ros', 'replay', '--no-report', str(bag), '-o', str(out)]
    running = subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True)
    part, deadline = out / 'frames.csv.part', time.monotonic() + PATIENCE_S
    while not part.exists() or part.stat().st_size < 500:
        assert time.monotonic() < deadline and running.poll() is None
        time.sleep(0.01)
    running.send_signal(signal.SIGHUP)
    _, stderr = running.communicate(timeout=PATIENCE_S)
    assert (running.returncode, stderr) == (
        3, 'interrupted; what was written so far is kept in the .part files\n')
    with BagReader(out / 'detections.mcap.part') as reader:
        assert len([*reader.messages(['/detections'])]) > 0
        assert reader.damaged is None
