"""Kernels compiled by processes of their own, where the cache of numba does not hold them yet.

One process alone takes the longer, and keeps the memory of the compiler for good. Which kernels a start needs, for
what types of arguments, stands in ``kernels.json``, written by ``benchmarks.kernel_table``; what it lacks is compiled
where it is called. Run as a program, by an installation, this compiles all of the table.
"""

from __future__ import annotations

import json
import os
import selectors
import subprocess
import sys
from collections import deque
from collections.abc import Callable, Sequence
from contextlib import suppress
from dataclasses import asdict
from functools import lru_cache
from importlib import resources
from pathlib import Path
from typing import IO

from motion_detect_ros import kernel_process
from motion_detect_ros.core.compilation import NotCachedError, compilation_told, only_cached
from motion_detect_ros.core.config import PipelineConfig
from motion_detect_ros.core.kernels import can_be_cached
from motion_detect_ros.core.pipeline import warm_up
from motion_detect_ros.kernel_process import Signature

TABLE = 'kernels.json'
#: More processes than this would wait for the longest job.
MAX_PROCESSES = 4
#: The kinds of start: stages before the objects, objects of flow, objects of points too.
FIRST_STAGES, FLOW, POINTS = 'first_stages', 'flow', 'points'
KINDS = (FIRST_STAGES, FLOW, POINTS)


@lru_cache(maxsize=1)
def signatures() -> tuple[Signature, ...]:
    """All of ``kernels.json``."""
    rows = json.loads(resources.files('motion_detect_ros').joinpath(TABLE).read_text(encoding='utf-8'))
    return tuple(Signature.of(row) for row in rows)


def kind_of(config: PipelineConfig, detects: bool) -> str:
    """Which of ``KINDS`` a start is."""
    if not detects:
        return FIRST_STAGES
    return POINTS if config.trajectories.use else FLOW


def warm_up_ahead(config: PipelineConfig, detects: bool, tell: Callable[[int], None]) -> None:
    """``warm_up``, after other processes have compiled what it needs, where it needs any.

    tell: called as each kernel begins, or is done in another process, with how many there were so far.
    """
    if from_cache(config, detects):
        return
    if can_be_cached():
        compile_elsewhere([each for each in signatures() if kind_of(config, detects) in each.kinds], tell)
    with compilation_told(tell):
        warm_up(config, detects)


def from_cache(config: PipelineConfig, detects: bool = True) -> bool:
    """``warm_up``, as far as no kernel has to be compiled; whether none had to be."""
    with suppress(NotCachedError), only_cached():
        warm_up(config, detects)
        return True
    return False


def compile_elsewhere(wanted: Sequence[Signature], tell: Callable[[int], None]) -> None:
    """Returns when all are compiled, or could not be: what fails is not told, for who calls it will see."""
    todo = jobs(wanted)
    compilers: list[_Compiler] = []
    try:
        for _ in range(min(MAX_PROCESSES, len(os.sched_getaffinity(0)), len(todo))):
            compilers.append(_Compiler())
        with selectors.DefaultSelector() as waiting:
            for each in compilers:
                each.begin(todo)
                waiting.register(each.done, selectors.EVENT_READ, each)
            count = 0
            tell(1)
            while waiting.get_map():
                for key, _ in waiting.select():
                    told = os.read(key.fd, 4096)
                    if not told:
                        waiting.unregister(key.fileobj)
                    for _ in range(told.count(b'\n')):
                        count += 1
                        tell(count)
                        key.data.done_one(todo)
    except OSError:  # no more processes, or one that has ended: who calls the kernels compiles them
        return
    finally:
        for each in compilers:
            each.end()


def jobs(wanted: Sequence[Signature]) -> deque[list[Signature]]:
    """What is handed out one after the other to who is free, the longest first.

    Those of one module stay together, as what they call is compiled once in each process.
    """
    modules: dict[str, list[Signature]] = {}
    for each in wanted:
        modules.setdefault(each.kernel.partition(':')[0], []).append(each)
    return deque(sorted(modules.values(), key=lambda job: sum(one.seconds for one in job), reverse=True))


class _Compiler:
    """A process that compiles. It imports from where this one does, and not from whatever folder it is started in."""

    def __init__(self) -> None:
        path = os.pathsep.join(str(Path(each).absolute()) for each in sys.path)
        self._process = subprocess.Popen(
            [sys.executable, '-P', '-m', kernel_process.__name__], env={**os.environ, 'PYTHONPATH': path}, bufsize=0,
            stdin=subprocess.PIPE, stdout=subprocess.PIPE, stderr=subprocess.DEVNULL, start_new_session=True)
        self._left = 0

    @property
    def done(self) -> IO[bytes]:
        """A line for each kernel."""
        return self._process.stdout  # type: ignore[return-value]

    def begin(self, todo: deque[list[Signature]]) -> None:
        """The next job, or none. Raises: OSError where the process has ended."""
        to: IO[bytes] = self._process.stdin  # type: ignore[assignment]
        if not todo:
            to.close()
            return
        job = todo.popleft()
        self._left = len(job)
        to.write(json.dumps([asdict(each) for each in job]).encode() + b'\n')

    def done_one(self, todo: deque[list[Signature]]) -> None:
        """One kernel of its job. Raises: OSError where the process has ended."""
        self._left -= 1
        if self._left == 0:
            self.begin(todo)

    def end(self) -> None:
        """At once."""
        with suppress(OSError):
            self._process.kill()
        for pipe in (self._process.stdin, self._process.stdout):
            pipe.close()  # type: ignore[union-attr]
        self._process.wait()


def main() -> None:
    """Those of all starts in the table. Raises: SystemExit where they are not in the cache then."""
    if can_be_cached():
        compile_elsewhere(signatures(), lambda count: None)
    if not from_cache(PipelineConfig()):
        raise SystemExit('they are not in the cache of numba: it cannot be written, or a compiler has failed')


if __name__ == '__main__':
    main()
