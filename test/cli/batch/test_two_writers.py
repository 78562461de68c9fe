"""Two processes that want the same folder: one writes, the other says so, and nothing is whole that is not."""

from __future__ import annotations

import errno
import fcntl
import json
import os
import signal
import subprocess
import sys
import time
from collections.abc import Callable
from pathlib import Path

import pytest
from batch_flights import FRAMES, PATIENCE_S, write_flight
from test_many_inputs import dask_cluster

from motion_detect_ros.__main__ import main
from motion_detect_ros.cli.batch.jobs import OK, UNREADABLE, Job
from motion_detect_ros.cli.batch.one_input import run_job
from motion_detect_ros.core.config import PipelineConfig
from motion_detect_ros.results.files import OUTPUT_NAMES

pytestmark = pytest.mark.messages

#: Long enough to be found at work.
LONG = 300
SAME = 'detections.csv', 'detections.mcap', 'frames.csv'


def start(*words: str | Path) -> subprocess.Popen[str]:
    command = [sys.executable, '-m', 'motion_detect_ros', 'replay', '--no-report', *map(str, words)]
    return subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True)


def end(process: subprocess.Popen[str]) -> tuple[int, str, str]:
    """Exit code and what it said."""
    stdout, stderr = process.communicate(timeout=PATIENCE_S)
    return process.returncode, stdout, stderr


def once(condition: Callable[[], object], process: subprocess.Popen[str] | None = None) -> None:
    """Wait for it; the process has to be there meanwhile."""
    deadline = time.monotonic() + PATIENCE_S
    while not condition():
        assert time.monotonic() < deadline
        assert process is None or process.poll() is None, process.communicate()
        time.sleep(0.01)


def rows(folder: Path) -> int:
    part = folder / 'frames.csv.part'
    return part.read_bytes().count(b'\n') - 1 if part.exists() else 0


@pytest.fixture(scope='module')
def flight(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return write_flight(tmp_path_factory.mktemp('flights') / 'a.mcap', frames=LONG)


@pytest.fixture(scope='module')
def expected(flight: Path) -> dict[str, bytes]:
    out = flight.parent / 'expected'
    assert main(['replay', '--no-report', str(flight), '-o', str(out)]) == 0
    return {name: (out / name).read_bytes() for name in SAME}


def assert_whole(folder: Path, expected: dict[str, bytes]) -> None:
    assert json.loads((folder / 'summary.json').read_text())['complete'] is True
    assert {name: (folder / name).read_bytes() for name in SAME} == expected
    assert sorted(path.name for path in folder.iterdir()) == sorted(OUTPUT_NAMES)


@pytest.mark.parametrize('words', [[], ['--force']])
def test_a_folder_that_another_process_writes_is_left_to_it(
    words: list[str], flight: Path, expected: dict[str, bytes], tmp_path: Path,
):
    """The first one is stopped meanwhile, so that it is at work however busy the machine is."""
    out, other = tmp_path / 'out', write_flight(tmp_path / 'b.mcap')
    first = start(flight, '-o', out / 'a')
    once(lambda: rows(out / 'a') >= 5, first)
    first.send_signal(signal.SIGSTOP)
    alone = end(start(flight, '-o', out / 'a', *words))
    code, stdout, stderr = end(start(flight, other, '-o', out, *words))
    first.send_signal(signal.SIGCONT)
    line = f'error: {out}/a: is being written by another process (process {first.pid} on {os.uname().nodename})\n'
    assert alone == (2, '', line)
    assert (code, stderr) == (3, line)
    assert '2 inputs: 1 done, 1 failed\n' in stdout
    assert end(first)[::2] == (0, '')
    assert_whole(out / 'a', expected)


def contents(folder: Path) -> dict[str, bytes]:
    return {path.name: path.read_bytes() for path in folder.iterdir()}


def test_what_another_process_finished_meanwhile_is_not_overwritten(flight: Path, tmp_path: Path):
    """Both runs found ``out/x`` free when they began; the first one comes to its own ``x`` later."""
    out, mine, other = tmp_path / 'out', tmp_path / 'mine' / 'x.mcap', tmp_path / 'other' / 'x.mcap'
    for file in mine, other:
        file.parent.mkdir()
        write_flight(file)
    write_flight(tmp_path / 'y.mcap')
    first = start(flight, mine, '-o', out)
    once(lambda: rows(out / 'a') >= 5, first)
    first.send_signal(signal.SIGSTOP)
    assert end(start(other, tmp_path / 'y.mcap', '-o', out))[0] == 0
    theirs = contents(out / 'x')
    first.send_signal(signal.SIGCONT)
    code, stdout, stderr = end(first)
    assert (code, stderr) == (
        3, f'error: {out}/x: holds a result of something else (input {other}, now {mine}); --force overwrites it\n')
    assert '2 inputs: 1 done, 1 failed\n' in stdout
    assert contents(out / 'x') == theirs


@pytest.mark.parametrize('force', [False, True])
def test_a_job_that_was_finished_meanwhile_is_done_again_by_force_only(force: bool, tmp_path: Path):
    job = Job(str(write_flight(tmp_path / 'a.mcap')), tmp_path / 'out', PipelineConfig(), force=force)
    assert run_job(job).exit_code == OK
    told = list[int]()
    assert run_job(job, lambda done, total: told.append(done)).exit_code == OK
    assert len(told) == (FRAMES if force else 0)


def test_without_locks_the_last_one_to_come_has_the_folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    """As on Lustre that is mounted without ``flock``; the other gives nothing its final name."""
    def no_locks(*_: object) -> None:
        raise OSError(errno.ENOSYS, os.strerror(errno.ENOSYS))

    monkeypatch.setattr(fcntl, 'flock', no_locks)
    job = Job(str(write_flight(tmp_path / 'a.mcap')), tmp_path / 'out', PipelineConfig())
    inner = []

    def watch(done: int, total: int | None) -> None:
        if done == 5:
            inner.append(run_job(job))

    outcome = run_job(job, watch)
    assert (inner[0].exit_code, outcome.exit_code) == (OK, UNREADABLE)
    assert outcome.line.startswith(f'error: {tmp_path}/out: is being written by another process')
    summary = json.loads((job.folder / 'summary.json').read_text())
    assert (summary['complete'], summary['frames']) == (True, FRAMES)
    assert (job.folder / 'frames.csv').read_text().count('\n') == FRAMES + 1


def worker_at(folder: Path) -> int:
    """The process that writes a folder."""
    return int((folder / '.writing').read_text().split()[1])


def test_a_dask_client_that_is_killed_is_followed_by_the_next(
    flight: Path, expected: dict[str, bytes], tmp_path: Path,
):
    """Its worker goes on with a folder that the second client wants: it is told to stop, and nobody's files mix."""
    out = tmp_path / 'out'
    (tmp_path / 'dask').mkdir()
    with dask_cluster(tmp_path / 'dask', 2, {**os.environ}) as file:
        first = start(flight, '-o', out, '--scheduler', file)
        once(lambda: rows(out) >= 5, first)
        stopped, (lease,) = worker_at(out), out.glob('.replay-*')
        os.kill(stopped, signal.SIGSTOP)  # at work, however long the second one takes to come
        try:
            first.kill()
            end(first)
            second = start(flight, '-o', out, '--scheduler', file)
            once(lambda: not lease.exists(), second)
        finally:
            os.kill(stopped, signal.SIGCONT)
        assert end(second)[::2] == (0, '')
    assert_whole(out, expected)


def test_a_dask_worker_that_was_believed_dead_goes_on(
    flight: Path, expected: dict[str, bytes], tmp_path: Path,
):
    """Stopped for longer than the scheduler waits for a sign of it; then both have the same job."""
    out = tmp_path / 'out'
    (tmp_path / 'dask').mkdir()
    environment = {**os.environ, 'DASK_DISTRIBUTED__SCHEDULER__WORKER_TTL': '3s'}
    with dask_cluster(tmp_path / 'dask', 2, environment) as file:
        client = start(flight, '-o', out, '--scheduler', file)
        once(lambda: rows(out) >= 5, client)
        stopped = worker_at(out)
        os.kill(stopped, signal.SIGSTOP)
        try:
            once(lambda: 'failed to heartbeat' in (tmp_path / 'dask' / '0.log').read_text(), client)
            time.sleep(3.0)
        finally:
            os.kill(stopped, signal.SIGCONT)
        assert end(client)[::2] == (0, '')
    assert_whole(out, expected)
