"""Jobs on the workers of an existing Dask cluster, whose scheduler shares them out, again where a worker dies."""

from __future__ import annotations

import asyncio
import gc
import json
import logging
import platform
import queue
import shutil
import threading
import time
import uuid
from collections.abc import Iterator, Sequence
from contextlib import contextmanager, suppress
from dataclasses import asdict
from pathlib import Path
from typing import Any

import cv2
import numba
import numpy as np
import scipy

import motion_detect_ros
from motion_detect_ros.cli.batch.jobs import NOTHING, UNREADABLE, Ended, Job, Outcome, StoppedError
from motion_detect_ros.cli.batch.one_input import run_job
from motion_detect_ros.cli.progress import Board
from motion_detect_ros.core.errors import BackendError, SourceError
from motion_detect_ros.core.threads import use
from motion_detect_ros.results.files import write_whole
from motion_detect_ros.results.ownership import LOCK_NAME, is_owned, owned

CONNECT_S = 20.0
#: What answers nothing is given up after so many times as long.
PATIENCE = 1.25
#: How often a job says how far it is and looks whether it is still wanted, s.
LOOK_S = 1.0
#: How long a job waits for a folder that another process writes: longer than a file server keeps the locks of a machine
#: that has gone (NFS 4: 90 s).
FREE_S = 120.0
_EXPECTED = 'expected the address of a Dask scheduler (tcp://HOST:8786) or the file that it wrote'
_NO_DASK = 'what answers there is no Dask'
TOPIC = 'motion_detect_ros.replay'


def run_on_cluster(
    jobs: Sequence[Job], scheduler: str, output: Path, board: Board, ended: Ended,
) -> None:
    """All jobs on the cluster of a scheduler, given by its address or by the file that it wrote.

    output: a folder that all workers see under the same path, as they see the inputs.
    Raises: BackendError without dask.distributed; SourceError where no scheduler answers, or a worker has other
    versions or does not see the folder.
    """
    try:
        import distributed
    except ModuleNotFoundError as error:
        raise BackendError('--scheduler: expected dask.distributed (pip install distributed), '
                           f'but {error.name} is missing') from None
    cluster: Any = distributed  # half annotated
    with _lease(output) as lease, _connect(cluster, scheduler) as client:
        _check(client, scheduler, lease, board)
        client.subscribe_topic(topic_of(str(lease)), lambda event: board.advance(*event[1]))
        job_of = {client.submit(work, job, str(lease), versions(), key=f'{job.name}-{uuid.uuid4().hex}',
                                priority=-number): job for number, job in enumerate(jobs)}
        for future in cluster.as_completed([*job_of], loop=client.loop):
            ended(job_of[future], _outcome(job_of[future], future))


def topic_of(lease: str) -> str:
    """Where the workers say how far they are: one for each run, as a scheduler tells what was said in earlier ones."""
    return f'{TOPIC}.{Path(lease).name}'


def versions() -> dict[str, str]:
    """What the bytes of the results depend on, beside settings and input."""
    return {'motion_detect_ros': motion_detect_ros.__version__, 'python': '.'.join(platform.python_version_tuple()[:2]),
            'opencv': cv2.__version__, 'numpy': np.__version__, 'scipy': scipy.__version__, 'numba': numba.__version__}


def work(job: Job, lease: str, expected: dict[str, str]) -> Outcome:
    """On a worker: one job, as long as somebody wants it, with the threads of the worker.

    That is while the folder ``lease`` is there, and the scheduler has a client that waits for the task.

    What is finished is not done again: the scheduler asks for it where the worker died that has the answer. One that it
    believes dead may still be at work, and is waited for.
    """
    from distributed import get_worker
    worker, finished = get_worker(), Path(lease) / job.name
    task = worker.get_current_task()
    _await_free(job.folder, lease)
    if (outcome := answered(finished)) is not None:
        return outcome
    trouble = _trouble(lease, expected)
    if not trouble and not Path(job.path).exists():
        trouble = f'no {job.path}; expected a folder that all machines share'
    if trouble:
        return Outcome(UNREADABLE, f'error: worker {worker.address}: {trouble}')
    use(max(1, worker.state.nthreads))
    last_s = time.monotonic()

    def watch(done: int, total: int | None) -> None:
        nonlocal last_s
        if time.monotonic() - last_s < LOOK_S:
            return
        last_s = time.monotonic()
        worker.log_event(topic_of(lease), (job.name, done, total))
        if not Path(lease).exists() or _is_cancelled(worker, task):
            raise StoppedError

    outcome = run_job(job, watch)
    with suppress(FileNotFoundError):  # nobody wants it any more
        write_whole(finished, json.dumps(asdict(outcome)))
    return outcome


def _is_cancelled(worker: Any, task: Any) -> bool:
    """Whether the scheduler has told the worker that a task which it is at is wanted no more: its client has gone."""
    state = worker.state.tasks.get(task)
    return state is None or state.state == 'cancelled'


def answered(finished: Path) -> Outcome | None:
    """What an earlier worker left of a job, None where there is nothing that can be read: the job is done anew then."""
    try:
        content = json.loads(finished.read_text(encoding='utf-8'))
        outcome = Outcome(**content)
    except (OSError, ValueError, TypeError, RecursionError):
        return None
    return outcome if isinstance(outcome.exit_code, int) and isinstance(outcome.line, str) else None


def _await_free(folder: Path, lease: str) -> None:
    """Until nobody else writes the folder, nobody wants the result any more, or it takes too long."""
    end_s = time.monotonic() + FREE_S
    while is_owned(folder) and Path(lease).exists() and time.monotonic() < end_s:
        time.sleep(LOOK_S)


def probe(lease: str, expected: dict[str, str]) -> str:
    """On a worker: what is wrong with it, empty for nothing."""
    return _trouble(lease, expected)


def _trouble(lease: str, expected: dict[str, str]) -> str:
    different = [f'{name} {own}, here {expected[name]}' for name, own in versions().items() if own != expected[name]]
    if different:
        return f'has {", ".join(different)}: results would differ'
    if not Path(lease).is_dir():
        return f'does not see the output folder {Path(lease).parent}; expected one that all machines share'
    return ''


def _connect(distributed: Any, scheduler: str) -> Any:
    """A client. Raises: SourceError where no scheduler answers."""
    for name in ('distributed', 'distributed.client'):  # what matters is said in one line
        logging.getLogger(name).setLevel(logging.CRITICAL)
    address = _address_of(scheduler)
    try:
        _reach(distributed, address)
        return distributed.Client(address, timeout=CONNECT_S, set_as_default=False)
    except Exception as error:  # whatever Dask makes of an address that is none, or of what answers there
        reason = ' '.join(str(error).split()) or type(error).__name__
    gc.collect()  # ends what was made of a client; when Python ends its threads are gone, and it would wait for them
    raise SourceError(f'--scheduler {scheduler}: {_EXPECTED}: {reason}')


def _reach(distributed: Any, address: str) -> None:
    """Greet what is at an address, as a client would wait for ever for the greeting of what is no Dask.

    Raises: TimeoutError where none comes; whatever Dask raises otherwise.
    """
    async def greet() -> None:
        certificates = distributed.Security().get_connection_args('client')  # of Dask's configuration, as a client's
        comm = await distributed.comm.connect(address, timeout=CONNECT_S, **certificates)
        await comm.close()

    def run() -> None:
        try:
            asyncio.run(greet())
            ended.put(None)
        except MemoryError:  # a greeting in another language, taken for a length
            ended.put(TimeoutError(_NO_DASK))
        except Exception as error:  # raised below
            ended.put(error)

    ended: queue.SimpleQueue[Exception | None] = queue.SimpleQueue()
    threading.Thread(target=run, daemon=True).start()
    try:
        error = ended.get(timeout=PATIENCE * CONNECT_S)
    except queue.Empty:
        error = TimeoutError(_NO_DASK)
    if error is not None:
        raise error


def _address_of(scheduler: str) -> str:
    """The address that is given, or that is in the file. Raises: SourceError where it is neither."""
    try:
        if not Path(scheduler).is_file():
            if ':' not in scheduler:
                raise SourceError(
                    f'--scheduler {scheduler}: {_EXPECTED}; there is no such file, and an address has a port')
            return scheduler
        address = json.loads(Path(scheduler).read_text(encoding='utf-8'))['address']
        if not isinstance(address, str):
            raise TypeError
    except OSError as error:
        raise SourceError(f'--scheduler {scheduler}: cannot be read: {error.strerror}') from None
    except (ValueError, TypeError, KeyError, RecursionError):
        raise SourceError(f'--scheduler {scheduler}: expected the file that a Dask scheduler wrote, '
                          'got one without its address') from None
    return address


def _check(client: Any, scheduler: str, lease: Path, board: Board) -> None:
    """Raises: SourceError for the workers of now; those that come later are asked with each job."""
    answers = client.run(probe, str(lease), versions(), on_error='return')
    if not answers:
        board.say(f'{scheduler}: no workers yet; waiting for some')
    troubles = [f'worker {address}: {_said(answer)}' for address, answer in sorted(answers.items()) if answer]
    if troubles:
        raise SourceError(f'--scheduler {scheduler}: {"; ".join(troubles)}')


def _said(answer: str | Exception) -> str:
    """What a worker answered; one without this package cannot even read the question."""
    return answer if isinstance(answer, str) else f'{type(answer).__name__}: {answer}'


def _outcome(job: Job, future: Any) -> Outcome:
    """That of a task; the scheduler gives it up after ``distributed.scheduler.allowed-failures`` deaths."""
    error = None if future.cancelled() else future.exception()
    if future.cancelled():
        return Outcome(NOTHING, f'error: {job.path}: the scheduler has gone')
    if error is None:
        return future.result()
    if type(error).__name__ == 'KilledWorker':
        return Outcome(NOTHING, f'error: {job.path}: its worker died, several times (out of memory?)')
    return Outcome(NOTHING, f'error: {job.path}: {type(error).__name__}: {error}')


@contextmanager
def _lease(output: Path) -> Iterator[Path]:
    """A folder in the output folder: workers see by it that that one is shared, and go on only as long as it is there.

    It takes what finished jobs answered. Those of killed clients of this machine are taken away, so that their workers
    stop. Raises: SourceError where it cannot be written.
    """
    ours = f'.replay-{platform.node()}-'
    lease = output / f'{ours}{uuid.uuid4().hex}'
    try:
        output.mkdir(parents=True, exist_ok=True)
        for other in output.glob(f'{ours}*'):
            if (other / LOCK_NAME).exists() and not is_owned(other):
                _remove(other)
        lease.mkdir()
    except OSError as error:
        raise SourceError(f'{output}: cannot be made a folder for the outputs: {error.strerror}') from None
    with owned(lease):
        try:
            yield lease
        finally:
            _remove(lease)


def _remove(lease: Path) -> None:
    with suppress(OSError):  # under its name a worker that writes into it now could keep it alive
        lease = lease.rename(lease.with_name(f'{lease.name}.gone'))
    shutil.rmtree(lease, ignore_errors=True)
