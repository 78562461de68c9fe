"""What becomes of the workers of a Dask cluster whose client was killed, and of answers that cannot be read."""

from __future__ import annotations

import json
import os
import signal
import subprocess
import sys
import time
from collections.abc import Callable
from pathlib import Path

import pytest
from batch_flights import PATIENCE_S, write_flight
from test_many_inputs import dask_cluster

from motion_detect_ros.cli.batch.cluster import answered
from motion_detect_ros.cli.batch.jobs import PARTIAL, Outcome
from motion_detect_ros.results.ownership import is_owned

pytestmark = pytest.mark.messages


def until(condition: Callable[[], bool]) -> bool:
    deadline = time.monotonic() + PATIENCE_S
    while not condition():
        if time.monotonic() > deadline:
            return False
        time.sleep(0.05)
    return True


def test_workers_stop_when_their_client_is_killed(tmp_path: Path):
    """The first bag is stopped long before its end, the second one is never begun."""
    bags = [write_flight(tmp_path / f'flight_{number}.mcap', number, 600) for number in range(2)]
    begun, other = tmp_path / 'out' / 'flight_0', tmp_path / 'out' / 'flight_1'
    with dask_cluster(tmp_path, 1, {**os.environ}) as file:
        client = subprocess.Popen([
            sys.executable, '-m', 'motion_detect_ros', 'replay', '--no-report', *map(str, bags),
            '-o', str(tmp_path / 'out'), '--scheduler', str(file)], start_new_session=True)
        try:
            part = begun / 'frames.csv.part'
            assert until(lambda: part.is_file() and part.stat().st_size > 1000)
        finally:
            os.killpg(client.pid, signal.SIGKILL)
            client.wait()
        assert until(lambda: not is_owned(begun))
        time.sleep(2.0)  # a worker that goes on would have begun with the other by then
        assert not other.exists()
    assert not (begun / 'frames.csv').exists()
    assert json.loads((begun / 'summary.json').read_text())['complete'] is False
    assert len(part.read_text().splitlines()) < 500


@pytest.mark.parametrize('content', [
    '', '{"exit_code": 0, "li', '[' * 100_000, '[0, "done"]', '{"exit_code": 0}', '{"other": 1}', 'null',
    '{"exit_code": "0", "line": "done"}', '{"exit_code": 0, "line": 5}'],
    ids=['empty', 'cut off', 'nested too deep', 'a list', 'a field missing', 'other fields', 'nothing', 'a text',
         'a number'])
def test_an_answer_that_cannot_be_read_is_none_and_its_job_is_done_anew(tmp_path: Path, content: str):
    (tmp_path / 'flight').write_text(content)
    assert answered(tmp_path / 'flight') is None


def test_an_answer_is_read(tmp_path: Path):
    assert answered(tmp_path / 'flight') is None
    (tmp_path / 'flight').write_text('{"exit_code": 3, "line": "out: 5 frames", "earlier": false}')
    assert answered(tmp_path / 'flight') == Outcome(PARTIAL, 'out: 5 frames')
