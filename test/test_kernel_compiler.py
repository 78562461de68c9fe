"""Kernels compiled ahead by processes of their own."""

from __future__ import annotations

import json
import os
import subprocess
import sys
from dataclasses import replace
from pathlib import Path

import pytest
from batch_flights import write_flight

from motion_detect_ros.benchmarks.kernel_table import recorded
from motion_detect_ros.cli import selftest
from motion_detect_ros.cli.compiled_kernels import COMPILING, compile_missing
from motion_detect_ros.kernel_compiler import KINDS, compile_elsewhere, jobs, signatures
from motion_detect_ros.kernel_process import Signature
from motion_detect_ros.presets import load_preset, with_settings

#: Warms up and prints how many kernels other processes and this one compiled, and what was told.
START = """
import json, sys
from numba.core import event
from motion_detect_ros import kernel_compiler
from motion_detect_ros.presets import load_preset
class Count(event.Listener):
    own = 0
    def on_start(self, _):
        self.own += 1
    def on_end(self, _):
        pass
count, told = Count(), []
elsewhere = kernel_compiler.compile_elsewhere
def counted(wanted, tell):
    elsewhere({wanted}, tell)
    event.register('numba:compile', count)
kernel_compiler.compile_elsewhere = counted
kernel_compiler.warm_up_ahead(load_preset('default'), {detects}, told.append)
print(json.dumps([count.own, told]))
"""


def start(cache: Path, detects: bool, wanted: str = 'wanted') -> tuple[int, list[int]]:
    done = subprocess.run(
        [sys.executable, '-c', START.format(detects=detects, wanted=wanted)], capture_output=True, text=True,
        env={**os.environ, 'NUMBA_CACHE_DIR': str(cache)}, timeout=300, check=False)
    assert done.returncode == 0, done.stderr
    own, told = json.loads(done.stdout)
    return own, told


@pytest.mark.parametrize('kind', KINDS)
def test_the_table_is_what_a_start_compiles(kind: str) -> None:
    """Else write it anew: ``python -m motion_detect_ros.benchmarks.kernel_table --write``."""
    wanted = {(each.kernel, each.arguments) for each in recorded(kind)}
    assert {(each.kernel, each.arguments) for each in signatures() if kind in each.kinds} == wanted
    assert len(wanted) > 3


def test_a_first_start_has_its_kernels_compiled_elsewhere_and_a_second_one_needs_none(tmp_path: Path) -> None:
    own, told = start(tmp_path, detects=False)
    assert own == 0
    assert told[:2] == [1, 1] and told[-1] == len([each for each in signatures() if 'first_stages' in each.kinds])
    assert start(tmp_path, detects=False) == (0, [])


def test_what_cannot_be_compiled_elsewhere_is_compiled_where_it_is_called(tmp_path: Path) -> None:
    unknown = "[kernel_compiler.Signature('core.nothing:no', ('float99',), 1.0, ('first_stages',))]"
    own, told = start(tmp_path, detects=False, wanted=unknown)
    assert own >= 6
    assert told[0] == 1


def test_compilers_import_from_where_the_node_does_and_not_from_its_folder(tmp_path: Path) -> None:
    """A node is started in any folder: in one with another copy of the package, or with files of anybody."""
    (tmp_path / 'selectors.py').write_text(f'open({str(tmp_path / "run")!r}, "w")')
    words = [sys.executable, '-P', '-c', START.format(detects=False, wanted='wanted')]
    done = subprocess.run(words, capture_output=True, text=True, cwd=tmp_path, timeout=300, check=False,
                          env={**os.environ, 'NUMBA_CACHE_DIR': str(tmp_path / 'cache')})
    assert done.returncode == 0, done.stderr
    assert json.loads(done.stdout)[0] == 0
    assert not (tmp_path / 'run').exists()


@pytest.mark.parametrize('program', ['/no/such/program', '/bin/false'])
def test_without_compilers_a_start_goes_on(program: str, monkeypatch: pytest.MonkeyPatch) -> None:
    told = list[int]()
    monkeypatch.setattr(sys, 'executable', program)
    for _ in range(5):
        compile_elsewhere([each for each in signatures() if 'first_stages' in each.kinds], told.append)
    assert set(told) <= {1}  # the first begins, and none is ever done


def test_jobs_are_whole_modules_and_the_longest_comes_first() -> None:
    one = Signature('core.a:f', (), 1.0, ())
    wanted = [replace(one, kernel=f'core.{module}:{name}', seconds=seconds) for module, name, seconds in (
        ('a', 'f', 1.0), ('b', 'f', 2.5), ('a', 'g', 2.0), ('c', 'f', 0.5))]
    names = [[each.kernel for each in job] for job in jobs(wanted)]
    assert names == [['core.a:f', 'core.a:g'], ['core.b:f'], ['core.c:f']]


def test_a_compiler_that_ends_leaves_its_jobs_to_the_others(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """The first one started ends in its first job, without a word; of ten kernels the other one compiles the rest."""
    compilers = tmp_path / 'compilers'
    compilers.write_text(f'#!/bin/sh\nif mkdir {tmp_path}/first 2>/dev/null; then read job; exit; fi\n'
                         'while read job; do echo done; done\n')
    compilers.chmod(0o755)
    monkeypatch.setattr(sys, 'executable', str(compilers))
    monkeypatch.setattr(os, 'sched_getaffinity', lambda _: {0, 1})
    told = list[int]()
    compile_elsewhere([Signature(f'core.a{number}:f', (), 1.0, ()) for number in range(10)], told.append)
    assert told == [1, *range(1, 10)]


def test_a_compiler_imports_no_more_than_it_needs() -> None:
    """Two of them start beside a node on two cores, and each library takes its time twice."""
    done = subprocess.run([sys.executable, '-X', 'importtime', '-m', 'motion_detect_ros.kernel_process'],
                          stdin=subprocess.DEVNULL, capture_output=True, text=True, timeout=60, check=True)
    imported = {line.rpartition('|')[2].strip() for line in done.stderr.splitlines()}
    assert 'numba' in imported
    assert not imported & {'cv2', 'rclpy', 'scipy.linalg', 'scipy.optimize', 'scipy.spatial'}
    assert {name for name in imported if name.startswith('motion_detect_ros.')} <= {'motion_detect_ros.kernel_process'}


def replay(cache: Path, flight: Path, out: Path) -> subprocess.CompletedProcess[str]:
    return subprocess.run(
        [sys.executable, '-m', 'motion_detect_ros', 'replay', str(flight), '-o', str(out), '--no-report'],
        env={**os.environ, 'NUMBA_CACHE_DIR': str(cache)}, capture_output=True, text=True, timeout=300, check=True)


def test_the_first_replay_says_that_it_compiles_and_the_second_one_does_not(tmp_path: Path) -> None:
    flight = write_flight(tmp_path / 'flight.mcap')
    assert replay(tmp_path / 'cache', flight, tmp_path / 'first').stderr == f'{COMPILING}\n'
    assert replay(tmp_path / 'cache', flight, tmp_path / 'second').stderr == ''
    first, second = ((tmp_path / name / 'detections.csv').read_bytes() for name in ('first', 'second'))
    assert first == second


def test_settings_that_no_pipeline_takes_are_left_to_who_uses_them(capsys: pytest.CaptureFixture[str]) -> None:
    of_a_network = {'optical_flow.method': 'onnx', 'optical_flow.onnx_model': '/nowhere.onnx'}
    compile_missing(with_settings(load_preset('default'), of_a_network))
    assert capsys.readouterr().err == ''


def test_a_cache_that_keeps_nothing_is_seen(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """What other processes compiled is gone, or could not be written."""
    monkeypatch.setenv('NUMBA_CACHE_DIR', str(tmp_path))
    monkeypatch.setattr(selftest, 'compile_missing', lambda *_: None)
    found = selftest.compiled_kernels()
    assert (found.passed, 'NUMBA_CACHE_DIR' in found.cure) == (False, True)
    assert 'without a cache' in found.found
