"""Ten bags, one of them damaged and one empty, while a worker is killed: the same list and bytes whichever way."""

from __future__ import annotations

import json
import socket
import subprocess
import sys
import threading
import time
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager, suppress
from pathlib import Path
from types import SimpleNamespace

import pytest
from batch_flights import FRAMES, PATIENCE_S, trap, unused, write_flight

from motion_detect_ros.__main__ import main
from motion_detect_ros.cli.batch import cluster, processes
from motion_detect_ros.cli.batch.jobs import Job
from motion_detect_ros.core.config import PipelineConfig
from motion_detect_ros.sources.bags import BagReader, BagWriter

pytestmark = pytest.mark.messages

DAMAGED, EMPTY, KILLED = 'flight_3', 'flight_6', 'flight_4'
#: What the same input gives the same bytes of.
SAME = 'detections.csv', 'detections.mcap', 'frames.csv'


@pytest.fixture(scope='module')
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    bags = tmp_path_factory.mktemp('many') / 'flights'
    for number in range(10):
        write_flight(bags / f'flight_{number}.mcap', number)
    content = (bags / f'{DAMAGED}.mcap').read_bytes()
    (bags / f'{DAMAGED}.mcap').write_bytes(content[:int(0.7 * len(content))])
    with BagWriter(bags / f'{EMPTY}.mcap'):
        pass
    return bags


@pytest.fixture(scope='module')
def one_by_one(folder: Path) -> Path:
    out = folder.parent / 'one_by_one'
    assert main(['replay', '--no-report', str(folder), '-o', str(out)]) == 3
    return out


def states(out: Path) -> dict[str, str]:
    entries = json.loads((out / 'replay.json').read_text())['inputs']
    return {Path(entry['input']).stem: entry['state'] for entry in entries}


def assert_same(out: Path, expected: Path) -> None:
    assert states(out) == {f'flight_{number}': 'done' for number in range(10)} | {DAMAGED: 'partial', EMPTY: 'failed'}
    done = sorted(path.name for path in out.iterdir() if path.is_dir())
    assert done == [f'flight_{number}' for number in range(10) if f'flight_{number}' != EMPTY]
    for name in done:
        for file in SAME:
            assert (out / name / file).read_bytes() == (expected / name / file).read_bytes(), (name, file)
        assert not [*(out / name).glob('*.part')]
    assert not [*out.glob('.replay-*')]


def test_one_by_one(one_by_one: Path, capsys: pytest.CaptureFixture[str], folder: Path):
    assert_same(one_by_one, one_by_one)
    summaries = {name: json.loads((one_by_one / name / 'summary.json').read_text()) for name in ('flight_0', DAMAGED)}
    assert summaries['flight_0']['frames'] == FRAMES
    assert 5 <= summaries[DAMAGED]['frames'] < FRAMES
    rows = sum((one_by_one / name / 'detections.csv').read_text().count('\n') - 1 for name in states(one_by_one)
               if name != EMPTY)
    assert rows > 20, 'with nothing detected equal bytes would say little'
    assert main(['replay', '--no-report', str(folder), '-o', str(one_by_one)]) == 3
    captured = capsys.readouterr()
    assert captured.err == f'error: {folder}/{EMPTY}.mcap: the bag is empty (0 messages in 0 topics)\n'
    assert captured.out.splitlines()[-3:] == [
        '10 inputs: 8 finished earlier, 1 partial, 1 failed',
        f'partial: {folder}/{DAMAGED}.mcap: ' + captured.out.splitlines()[3].partition(': ')[2],
        f'failed: {folder}/{EMPTY}.mcap: the bag is empty (0 messages in 0 topics)']
    assert 'the end is missing' in captured.out.splitlines()[-2]


def replay_in_process(environment: dict[str, str], *words: str | Path) -> subprocess.CompletedProcess[str]:
    command = [sys.executable, '-m', 'motion_detect_ros', 'replay', '--no-report', *map(str, words)]
    return subprocess.run(command, env=environment, capture_output=True, text=True, timeout=PATIENCE_S, check=False)


def test_two_processes_one_of_them_killed(folder: Path, one_by_one: Path, tmp_path: Path):
    out = tmp_path / 'out'
    environment = trap(tmp_path, out / KILLED / 'frames.csv.part', 1)
    done = replay_in_process(environment, folder, '-o', out, '--workers', '2')
    assert (done.returncode, unused(tmp_path)) == (3, 0)
    assert f'{folder}/{KILLED}.mcap: its process was killed by SIGKILL (out of memory?); done again' in done.stderr
    assert '10 inputs: 8 done, 1 partial, 1 failed' in done.stdout.splitlines()
    assert_same(out, one_by_one)


def test_an_input_that_kills_its_process_every_time_is_given_up(
    folder: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str],
):
    """As one that needs more memory than there is; the others are done."""
    out, bags = tmp_path / 'out', [str(folder / f'{name}.mcap') for name in (KILLED, 'flight_0')]
    monkeypatch.setenv('PYTHONPATH', trap(tmp_path, out / KILLED / 'frames.csv.part', 5)['PYTHONPATH'])
    monkeypatch.setattr(processes, 'MAX_TRIES', 2)
    assert (main(['replay', '--no-report', *bags, '-o', str(out), '--workers', '2']), unused(tmp_path)) == (3, 3)
    said = f'failed: {bags[0]}: its process was killed by SIGKILL (out of memory?), 2 times'
    assert capsys.readouterr().out.splitlines()[-1] == said
    assert states(out) == {KILLED: 'failed', 'flight_0': 'done'}
    assert len((out / KILLED / 'frames.csv.part').read_text().splitlines()) > 5, 'what was written is readable'


def dask(environment: dict[str, str], log: Path, *words: str) -> subprocess.Popen[bytes]:
    with log.open('wb') as stream:
        return subprocess.Popen([sys.executable, '-m', 'dask', *words, '--host', '127.0.0.1'], stdout=stream,
                                stderr=stream, env=environment)


@contextmanager
def dask_cluster(folder: Path, workers: int, environment: dict[str, str]) -> Iterator[Path]:
    """``dask scheduler`` and some ``dask worker`` on loopback: the file in which the scheduler says where it is."""
    pytest.importorskip('distributed', reason='Dask is an extra')
    file = folder / 'scheduler.json'
    with ExitStack() as ends:
        def start(*words: str) -> subprocess.Popen[bytes]:
            process = dask(environment, folder / f'{len(started)}.log', *words)
            ends.callback(process.wait)
            ends.callback(process.kill)
            started.append(process)
            return process

        started: list[subprocess.Popen[bytes]] = []
        start('scheduler', '--port', '0', '--no-dashboard', '--scheduler-file', str(file))
        deadline = time.monotonic() + PATIENCE_S
        while not file.is_file():
            assert time.monotonic() < deadline
            assert started[0].poll() is None, (folder / '0.log').read_text()
            time.sleep(0.05)
        for _ in range(workers):
            start('worker', '--scheduler-file', str(file), '--nthreads', '1', '--no-nanny', '--no-dashboard',
                  '--local-directory', str(folder))
        yield file


def test_a_dask_scheduler_with_two_workers_one_of_them_killed(
    folder: Path, one_by_one: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str],
):
    environment = trap(tmp_path, tmp_path / 'out' / KILLED / 'frames.csv.part', 1)
    with dask_cluster(tmp_path, 2, environment) as file:
        assert main(['replay', '--no-report', str(folder), '-o', str(tmp_path / 'out'), '--scheduler', str(file)]) == 3
    assert unused(tmp_path) == 0
    assert '10 inputs: 8 done, 1 partial, 1 failed' in capsys.readouterr().out.splitlines()
    assert_same(tmp_path / 'out', one_by_one)


@pytest.fixture(scope='module')
def local_cluster(tmp_path_factory: pytest.TempPathFactory) -> Iterator[str]:
    distributed = pytest.importorskip('distributed', reason='Dask is an extra')
    folder = tmp_path_factory.mktemp('local')
    with distributed.LocalCluster(n_workers=2, threads_per_worker=2, processes=True, dashboard_address='127.0.0.1:0',
                                  host='127.0.0.1', local_directory=str(folder)) as local:
        yield local.scheduler_address


def test_a_local_cluster_of_processes_with_two_threads_each(
    folder: Path, one_by_one: Path, tmp_path: Path, local_cluster: str,
):
    assert main(['replay', '--no-report', str(folder), '-o', str(tmp_path / 'out'), '--scheduler', local_cluster]) == 3
    assert_same(tmp_path / 'out', one_by_one)


def test_workers_of_other_versions_are_refused(
    folder: Path, tmp_path: Path, local_cluster: str, monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
):
    own = cluster.versions()
    monkeypatch.setattr(cluster, 'versions', lambda: {**own, 'opencv': '3.2.0'})
    assert main(['replay', '--no-report', str(folder), '-o', str(tmp_path / 'out'), '--scheduler', local_cluster]) == 2
    message = capsys.readouterr().err
    assert message.count(f'has opencv {own["opencv"]}, here 3.2.0: results would differ') == 2
    assert message.startswith(f'error: --scheduler {local_cluster}: worker tcp://127.0.0.1:')
    assert message.count('\n') == 1
    assert not [*(tmp_path / 'out').iterdir()]


def test_workers_that_do_not_see_the_folder_or_an_input_say_so(
    folder: Path, tmp_path: Path, local_cluster: str, monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
):
    words = ['-o', str(tmp_path / 'out'), '--scheduler', local_cluster]
    assert main(['replay', '--no-report', str(folder / 'nowhere.mcap'), *words]) == 2
    assert f': no {folder}/nowhere.mcap; expected a folder that all machines share\n' in capsys.readouterr().err

    @contextmanager
    def elsewhere(output: Path) -> Iterator[Path]:
        yield output / 'on another machine'

    monkeypatch.setattr(cluster, '_lease', elsewhere)
    assert main(['replay', '--no-report', str(folder), *words]) == 2
    message = capsys.readouterr().err
    assert message.count(f'does not see the output folder {tmp_path}/out; expected one that all machines share') == 2
    assert message.count('\n') == 1


def test_no_scheduler_there(
    folder: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str],
):
    pytest.importorskip('distributed', reason='Dask is an extra')
    monkeypatch.setattr(cluster, 'CONNECT_S', 0.5)
    for address in ('tcp://127.0.0.1:1', 'no address'):
        assert main(['replay', '--no-report', str(folder), '-o', str(tmp_path / 'out'), '--scheduler', address]) == 2
        message = capsys.readouterr().err
        assert message.startswith(f'error: --scheduler {address}: expected the address of a Dask scheduler')
        assert message.count('\n') == 1


@pytest.mark.parametrize('answer', [b'', b'HTTP/1.1 400 Bad Request\r\nContent-Length: 0\r\n\r\n'])
def test_what_is_no_dask_is_given_up(
    folder: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str], answer: bytes,
):
    """Some server: one that waits for its client to speak, and one that speaks another language."""
    pytest.importorskip('distributed', reason='Dask is an extra')
    monkeypatch.setattr(cluster, 'CONNECT_S', 1.0)
    with socket.create_server(('127.0.0.1', 0)) as server:
        address = f'tcp://127.0.0.1:{server.getsockname()[1]}'
        clients = []

        def serve() -> None:
            with suppress(OSError):
                while True:
                    client, _ = server.accept()
                    client.sendall(answer)
                    clients.append(client)

        threading.Thread(target=serve, daemon=True).start()
        assert main(['replay', '--no-report', str(folder), '-o', str(tmp_path / 'out'), '--scheduler', address]) == 2
        assert clients
        for client in clients:
            client.close()
    assert capsys.readouterr().err == (
        f'error: --scheduler {address}: expected the address of a Dask scheduler (tcp://HOST:8786) or the file that it '
        'wrote: what answers there is no Dask\n')


def test_without_dask_its_package_is_named(
    folder: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str],
):
    monkeypatch.setitem(sys.modules, 'distributed', None)
    words = ['replay', '--no-report', str(folder), '-o', str(tmp_path / 'out'), '--scheduler', 'tcp://127.0.0.1:8786']
    assert main(words) == 2
    assert capsys.readouterr().err == (
        'error: --scheduler: expected dask.distributed (pip install distributed), but distributed is missing\n')


def stand_in() -> SimpleNamespace:
    """A worker of one thread whose task the scheduler wants."""
    state = SimpleNamespace(nthreads=1, tasks={'task': SimpleNamespace(state='executing')})
    return SimpleNamespace(address='tcp://127.0.0.1:7', state=state, log_event=lambda *_: None,
                           get_current_task=lambda: 'task')


def test_what_a_worker_has_finished_is_not_done_again_when_it_dies(
    folder: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch,
):
    """The scheduler has another worker do again whatever it has not passed on yet."""
    worker = stand_in()
    monkeypatch.setitem(sys.modules, 'distributed', SimpleNamespace(get_worker=lambda: worker))
    monkeypatch.setattr(cluster, 'use', lambda threads: None)
    lease, job = tmp_path / 'lease', Job(str(folder / 'flight_0.mcap'), tmp_path / 'out', PipelineConfig())
    lease.mkdir()
    first = cluster.work(job, str(lease), cluster.versions())
    written = (job.folder / 'detections.csv').stat()
    assert cluster.work(job, str(lease), cluster.versions()) == first
    again = (job.folder / 'detections.csv').stat()
    assert (first.exit_code, again.st_ino, again.st_mtime_ns) == (0, written.st_ino, written.st_mtime_ns)


def test_each_run_has_its_own_lease_and_topic_and_nobody_keeps_it_alive(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch,
):
    remove, there = cluster.shutil.rmtree, []

    def removing(path: Path, **words: bool) -> None:
        there.append(lease.exists())
        remove(path, **words)

    monkeypatch.setattr(cluster.shutil, 'rmtree', removing)
    topics = set()
    for _ in range(2):
        with cluster._lease(tmp_path) as lease:
            (lease / 'answer').write_text('')
            topics.add(cluster.topic_of(str(lease)))
    assert there == [False, False], 'workers find it gone before it is emptied'
    assert not [*tmp_path.iterdir()]
    assert len(topics) == 2


def test_a_worker_stops_when_nobody_waits_for_it(folder: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    """As after Ctrl-C: the client takes its file away."""
    worker = stand_in()
    monkeypatch.setitem(sys.modules, 'distributed', SimpleNamespace(get_worker=lambda: worker))
    monkeypatch.setattr(cluster, 'LOOK_S', 0.0)
    monkeypatch.setattr(cluster, 'use', lambda threads: None)
    lease, job = tmp_path / 'lease', Job(str(folder / 'flight_0.mcap'), tmp_path / 'out', PipelineConfig())
    lease.mkdir()
    topics = set()

    def said(topic: str, event: tuple[str, int, int | None]) -> None:
        topics.add(topic)
        if event[1] == 5:
            lease.rmdir()

    worker.log_event = said
    outcome = cluster.work(job, str(lease), cluster.versions())
    assert (outcome.exit_code, outcome.line) == (3, f'{tmp_path}/out: stopped')
    assert topics == {f'{cluster.TOPIC}.lease'}
    assert json.loads((tmp_path / 'out' / 'summary.json').read_text())['frames'] == 5
    with BagReader(tmp_path / 'out' / 'detections.mcap.part') as reader:
        assert len([*reader.messages(['/detections'])]) == 5
