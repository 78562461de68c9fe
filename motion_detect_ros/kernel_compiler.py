"""Kernels compiled by processes of their own, a share each, where the cache of numba does not hold them yet.

One process alone takes the longer, and keeps the memory of the compiler for good. Which kernels a start needs, for
what types of arguments, stands in ``kernels.json``, written by ``benchmarks.kernel_table``; what it lacks is compiled
where it is called.
"""

from __future__ import annotations

import gc
import json
import os
import selectors
import subprocess
import sys
from collections.abc import Callable, Mapping, Sequence
from contextlib import suppress
from dataclasses import asdict, dataclass
from functools import lru_cache
from importlib import import_module, resources
from pathlib import Path
from typing import Any

from numba import types

from motion_detect_ros.core.compilation import NotCachedError, compilation_told, only_cached
from motion_detect_ros.core.config import PipelineConfig
from motion_detect_ros.core.kernels import can_be_cached
from motion_detect_ros.core.pipeline import warm_up

TABLE = 'kernels.json'
#: More processes than this would wait for the longest share.
MAX_PROCESSES = 4
#: The kinds of start: stages before the objects, objects of flow, objects of points too.
FIRST_STAGES, FLOW, POINTS = 'first_stages', 'flow', 'points'
KINDS = (FIRST_STAGES, FLOW, POINTS)


@dataclass(frozen=True)
class Signature:
    """A kernel and types of its arguments. ``kernel``: module and function, ``core.x.y:name``; ``arguments``: numba's
    representation of each; ``seconds``: about how long it takes to compile; ``kinds``: of start that need it.
    """

    kernel: str
    arguments: tuple[str, ...]
    seconds: float
    kinds: tuple[str, ...]

    @classmethod
    def of(cls, row: Mapping[str, Any]) -> Signature:
        """From what ``asdict`` of it is in JSON. Raises: KeyError where something is missing."""
        return cls(row['kernel'], tuple(row['arguments']), row['seconds'], tuple(row['kinds']))

    def dispatcher(self) -> Any:
        """The function to compile. Raises: ImportError, AttributeError for what is not there."""
        module, name = self.kernel.split(':')
        return getattr(import_module(f'motion_detect_ros.{module}'), name)

    def compile(self) -> None:
        """Into the cache. Raises: whatever numba makes of types that it does not know."""
        known = {**vars(types), 'bool': types.boolean}
        self.dispatcher().compile(tuple(eval(argument, known) for argument in self.arguments))


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
    processes: list[subprocess.Popen[bytes]] = []
    try:
        for share in shares(wanted, min(MAX_PROCESSES, len(os.sched_getaffinity(0)))):
            processes.append(_compiler())
            _give(processes[-1], share)
        with selectors.DefaultSelector() as waiting:
            for process in processes:
                waiting.register(process.stdout, selectors.EVENT_READ)  # type: ignore[arg-type]
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
    except OSError:  # no more processes, or one that has ended: who calls the kernels compiles them
        return
    finally:
        for process in processes:
            with suppress(OSError):
                process.kill()
            process.stdout.close()  # type: ignore[union-attr]
            process.wait()


def shares(wanted: Sequence[Signature], count: int) -> list[list[Signature]]:
    """Split among ``count`` processes that take about as long each: the longest first, to who has least to do.

    Those of one module stay together, as what they call is compiled once in each process.
    """
    modules: dict[str, list[Signature]] = {}
    for each in wanted:
        modules.setdefault(each.kernel.partition(':')[0], []).append(each)
    split: list[list[Signature]] = [[] for _ in range(count)]
    for together in sorted(modules.values(), key=_seconds, reverse=True):
        min(split, key=_seconds).extend(together)
    return [share for share in split if share]


def _seconds(share: Sequence[Signature]) -> float:
    return sum(one.seconds for one in share)


def _compiler() -> subprocess.Popen[bytes]:
    """Imports from where this process does, and not from whatever folder it is started in."""
    path = os.pathsep.join(str(Path(each).absolute()) for each in sys.path)
    return subprocess.Popen(
        [sys.executable, '-P', '-m', 'motion_detect_ros.kernel_compiler'], env={**os.environ, 'PYTHONPATH': path},
        stdin=subprocess.PIPE, stdout=subprocess.PIPE, stderr=subprocess.DEVNULL, start_new_session=True)


def _give(process: subprocess.Popen[bytes], share: Sequence[Signature]) -> None:
    with process.stdin as to:  # type: ignore[union-attr]
        to.write(json.dumps([asdict(each) for each in share]).encode())


def main() -> None:
    """Compiles what stands on standard input, and writes a line for each."""
    gc.disable()  # a tenth of the time; the process ends soon
    for row in json.loads(sys.stdin.read()):
        with suppress(Exception):  # a table of another version
            Signature.of(row).compile()
        print(row['kernel'], flush=True)


if __name__ == '__main__':
    main()
