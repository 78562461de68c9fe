"""Jobs in processes of this machine; one that is killed takes nothing with it but the time that it had worked."""

from __future__ import annotations

import multiprocessing
import signal
from collections import deque
from collections.abc import Sequence
from contextlib import suppress
from dataclasses import dataclass
from multiprocessing import resource_tracker
from multiprocessing.connection import Connection, wait
from multiprocessing.process import BaseProcess

from motion_detect_ros.cli.batch.jobs import NOTHING, Ended, Job, Outcome
from motion_detect_ros.cli.batch.one_input import run_job
from motion_detect_ros.cli.interrupts import interrupt_once
from motion_detect_ros.cli.progress import Board
from motion_detect_ros.core.threads import threads, use

#: So often an input may take its process down before it is given up.
MAX_TRIES = 3
#: How long an interrupted process may take to close its files, s.
CLOSING_S = 30.0


@dataclass
class Worker:
    """A process that does one job after the other; ``connection``: jobs to it, frame counts and outcomes back."""

    process: BaseProcess
    connection: Connection
    job: Job

    @classmethod
    def begin(cls, job: Job, workers: int) -> Worker:
        """Start a process with its first job. Spawned, not forked: thread pools of OpenCV and numba survive no fork.

        It is born with SIGINT blocked: the terminal's interrupts are its parent's also until ``serve`` can say so.
        """
        context = multiprocessing.get_context('spawn')
        ours, its = context.Pipe()
        process = context.Process(target=serve, args=(its, workers), daemon=True)
        resource_tracker.ensure_running()  # which unblocks signals when it starts
        signal.pthread_sigmask(signal.SIG_BLOCK, [signal.SIGINT])
        try:
            process.start()
        finally:
            signal.pthread_sigmask(signal.SIG_UNBLOCK, [signal.SIGINT])
        its.close()  # so that its death is the end of the connection
        worker = cls(process, ours, job)
        worker.give(job)
        return worker

    def give(self, job: Job) -> None:
        """One more job. Where the process has died meanwhile, the connection says so when it is read."""
        self.job = job
        with suppress(ConnectionError):
            self.connection.send(job)

    def stop(self) -> None:
        """Have it close its files and end."""
        self.process.terminate()
        self.process.join(CLOSING_S)
        if self.process.is_alive():
            self.process.kill()
            self.process.join()
        self.connection.close()


def run_in_processes(jobs: Sequence[Job], workers: int, board: Board, ended: Ended) -> None:
    """All jobs, ``workers`` at a time, each process with its share of the cores.

    The job of a process that died is done again, ``MAX_TRIES`` times at most.
    """
    waiting, tries = deque(jobs), dict.fromkeys(jobs, 0)
    at_work: list[Worker] = []
    try:
        while waiting or at_work:
            while waiting and len(at_work) < workers:
                at_work.append(Worker.begin(waiting.popleft(), workers))
            ready = wait([worker.connection for worker in at_work])
            for worker in [each for each in at_work if each.connection in ready]:
                try:
                    message = worker.connection.recv()
                except (EOFError, ConnectionError):
                    at_work.remove(worker)
                    tries[worker.job] += 1
                    _after_death(worker, tries[worker.job], waiting, board, ended)
                    continue
                if not isinstance(message, Outcome):
                    board.advance(worker.job.name, *message)
                    continue
                ended(worker.job, message)
                if waiting:
                    worker.give(waiting.popleft())
                else:
                    at_work.remove(worker)
                    worker.connection.close()
                    worker.process.join()
    finally:
        for worker in at_work:
            worker.stop()


def _after_death(worker: Worker, tries: int, waiting: deque[Job], board: Board, ended: Ended) -> None:
    worker.process.join()
    worker.connection.close()
    job, reason = worker.job, _reason(worker.process.exitcode or 0)
    if tries < MAX_TRIES:
        board.say(f'{job.path}: its process was {reason}; done again', error=True)
        board.restart(job.name)
        waiting.append(job)
    else:
        ended(job, Outcome(NOTHING, f'error: {job.path}: its process was {reason}, {tries} times'))


def _reason(exit_code: int) -> str:
    if exit_code >= 0:
        return f'ended with exit code {exit_code}'
    name = signal.Signals(-exit_code).name
    return f'killed by {name}' + (' (out of memory?)' if name == 'SIGKILL' else '')


def serve(connection: Connection, workers: int) -> None:
    """The life of a process: jobs from the connection until it closes. What the terminal says is its parent's."""
    for number in (signal.SIGINT, signal.SIGHUP):
        signal.signal(number, signal.SIG_IGN)
    interrupt_once(signal.SIGTERM)
    share_cores(workers)
    try:
        while True:
            job: Job = connection.recv()
            connection.send(run_job(job, lambda done, total: connection.send((done, total))))
    except (EOFError, ConnectionError, KeyboardInterrupt):
        return


def share_cores(workers: int) -> None:
    """One part in ``workers`` of the threads for this process; ``load.threads`` of a job replaces that."""
    use(max(1, threads() // workers))
