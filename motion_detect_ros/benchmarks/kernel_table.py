"""Which kernels every kind of start compiles, for what types: writes ``kernels.json`` of the package.

python -m motion_detect_ros.benchmarks.kernel_table --write
"""

from __future__ import annotations

import argparse
import json
import os
import subprocess
import sys
import tempfile
import time
from dataclasses import asdict, replace
from pathlib import Path

from numba.core import event

import motion_detect_ros
from motion_detect_ros.core.pipeline import warm_up
from motion_detect_ros.kernel_compiler import FIRST_STAGES, FLOW, KINDS, POINTS, TABLE
from motion_detect_ros.kernel_process import Signature
from motion_detect_ros.presets import load_preset

PRESETS = {FIRST_STAGES: 'default', FLOW: 'default', POINTS: 'visdrone'}
PACKAGE = 'motion_detect_ros.'


class _Recorder(event.Listener):
    """Signatures of what is compiled for itself; what it calls is compiled with it."""

    def __init__(self, kind: str) -> None:
        self._kind, self._begun = kind, list[float]()
        self.found: list[Signature] = []

    def on_start(self, _event: event.Event) -> None:
        self._begun.append(time.process_time())

    def on_end(self, ended: event.Event) -> None:
        seconds, data = time.process_time() - self._begun.pop(), ended.data
        module = data['dispatcher'].py_func.__module__
        if not self._begun and module.startswith(PACKAGE):
            self.found.append(Signature(
                f'{module.removeprefix(PACKAGE)}:{data["dispatcher"].py_func.__name__}',
                tuple(repr(each) for each in data['args']), round(seconds, 1), (self._kind,)))


def recorded(kind: str) -> list[Signature]:
    """What a start of this kind compiles, in a process and a cache of its own."""
    with tempfile.TemporaryDirectory() as cache:
        words = [sys.executable, '-m', 'motion_detect_ros.benchmarks.kernel_table', '--kind', kind]
        done = subprocess.run(words, env={**os.environ, 'NUMBA_CACHE_DIR': cache}, check=True, capture_output=True)
    return [Signature.of(row) for row in json.loads(done.stdout)]


def table() -> list[Signature]:
    """All kinds together, by name."""
    together: dict[tuple[str, tuple[str, ...]], Signature] = {}
    for kind in KINDS:
        for each in recorded(kind):
            known = together.get((each.kernel, each.arguments))
            kinds = (*known.kinds, kind) if known else each.kinds
            together[each.kernel, each.arguments] = replace(each, kinds=kinds)
    return sorted(together.values(), key=lambda one: (one.kernel, one.arguments))


def record(kind: str) -> list[Signature]:
    """What ``warm_up`` compiles in this process."""
    recorder = _Recorder(kind)
    event.register('numba:compile', recorder)  # type: ignore[no-untyped-call]
    warm_up(load_preset(PRESETS[kind]), kind != FIRST_STAGES)
    return recorder.found


def main() -> None:
    """Prints the table, or writes it."""
    parser = argparse.ArgumentParser(prog='kernel_table', description='Which kernels every kind of start compiles.')
    parser.add_argument('--write', action='store_true', help='write it to the package')
    parser.add_argument('--kind', choices=KINDS, help='only what this process compiles for one kind of start')
    arguments = parser.parse_args()
    rows = record(arguments.kind) if arguments.kind else table()
    text = '[\n' + ',\n'.join(json.dumps(asdict(row)) for row in rows) + '\n]\n'
    if arguments.write:
        Path(motion_detect_ros.__file__).with_name(TABLE).write_text(text, encoding='utf-8')
    else:
        print(text)


if __name__ == '__main__':
    main()
