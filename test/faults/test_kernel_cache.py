"""The cache of compiled kernels when it cannot be written, is damaged, full, or used by eight processes at once."""

from __future__ import annotations

import os
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path

import pytest

import motion_detect_ros

PACKAGE = Path(motion_detect_ros.__file__).parent
#: Runs one kernel and prints its answer, and how often it was loaded from the cache and compiled.
RUN = '''
{before}
import numpy as np
from motion_detect_ros.core.geometry.order_statistics import median
values = np.arange(101.0)[::-1].copy()
print(float(median(values)), sum(median.stats.cache_hits.values()), sum(median.stats.cache_misses.values()))
'''
COMPILED, LOADED = '50.0 0 1', '50.0 1 0'
PROCESSES = 8
#: Bytes of a disk that is full before anything is compiled.
FULL_KB = 4


def command(before: str = '') -> list[str]:
    return [sys.executable, '-c', RUN.format(before=before)]


def variables(**changes: object) -> dict[str, str]:
    """The environment, without a cache of the caller's own."""
    kept = {name: value for name, value in os.environ.items() if name != 'NUMBA_CACHE_DIR'}
    return {**kept, **{name: str(value) for name, value in changes.items()}}


def run(words: list[str], **changes: object) -> str:
    """What it prints; it must end well."""
    done = subprocess.run(words, env=variables(**changes), capture_output=True, text=True, check=False, timeout=300)
    assert done.returncode == 0, done.stderr
    return done.stdout.strip()


@pytest.fixture
def cache(tmp_path: Path) -> Path:
    """A folder with the compiled kernel."""
    folder = tmp_path / 'cache'
    assert run(command(), NUMBA_CACHE_DIR=folder) == COMPILED
    assert run(command(), NUMBA_CACHE_DIR=folder) == LOADED
    return folder


def files(folder: Path) -> list[Path]:
    return sorted(path for path in folder.rglob('*') if path.suffix in {'.nbi', '.nbc'})


def test_a_read_only_installation_runs_without_a_home(cache, shown):
    """Cache and package on read-only file systems, no home: nothing can be written anywhere."""
    if not mounts():
        pytest.skip('no right to mount: a read-only file system cannot be made')
    script = ' && '.join(f'mount --bind {one} {one} && mount -o remount,ro,bind {one}' for one in (cache, PACKAGE))
    words = ['unshare', '-m', 'sh', '-c', f'{script} && exec "$@"', 'sh', *command()]
    assert run(words, NUMBA_CACHE_DIR=cache, HOME='/proc') == COMPILED
    shown('the installation and the cache of kernels are read-only, there is no home folder',
          'kernels are compiled at every start, and run', 'right answer')


def test_no_place_for_a_cache_costs_compiling_only(shown):
    program = ('import numba.core.caching as caching\n'
               'def refuse(self): raise PermissionError(13, "Permission denied")\n'
               'caching._CacheLocator.ensure_cache_path = refuse')
    assert run(command(program), HOME='/proc') == COMPILED


@pytest.mark.parametrize('suffix', ['.nbi', '.nbc'])
@pytest.mark.parametrize('damage', [
    lambda data: b'', lambda data: data[:len(data) // 2], lambda data: bytes(len(data)),
    lambda data: data[:len(data) // 3] + bytes([data[len(data) // 3] ^ 255]) + data[len(data) // 3 + 1:],
], ids=['empty', 'cut', 'zeros', 'one byte'])
def test_a_damaged_cache_is_compiled_anew_and_mended(cache, suffix, damage: Callable[[bytes], bytes], shown):
    chosen = [path for path in files(cache) if path.suffix == suffix and 'median' in path.name]
    assert chosen
    for path in chosen:
        path.write_bytes(damage(path.read_bytes()))
    assert run(command(), NUMBA_CACHE_DIR=cache).startswith('50.0 ')
    assert run(command(), NUMBA_CACHE_DIR=cache) == LOADED
    shown('a cache of kernels that is empty, cut, zeroed or wrong in a byte', 'compiled anew, and mended',
          'index and code, loaded at the next start')


def test_a_full_disk_costs_compiling_only(tmp_path, shown):
    limit = 'import resource; resource.setrlimit(resource.RLIMIT_FSIZE, (512, 512))'
    words = command(limit)
    if mounts():
        folder = tmp_path / 'disk'
        folder.mkdir()
        script = f'mount -t tmpfs -o size={FULL_KB}k none {folder} && mkdir {folder}/cache && exec "$@"'
        words = ['unshare', '-m', 'sh', '-c', script, 'sh', *command()]
    assert run(words, NUMBA_CACHE_DIR=tmp_path / 'disk' / 'cache') == COMPILED
    shown('the disk is full while kernels are compiled', 'they run, uncached', 'right answer')


def mounts() -> bool:
    """Whether a small file system can be mounted here."""
    return subprocess.run(['unshare', '-m', 'mount', '-t', 'tmpfs', 'none', '/mnt'], capture_output=True,
                          check=False).returncode == 0


def test_eight_processes_fill_one_cache_at_once(tmp_path, shown):
    folder = tmp_path / 'cache'
    running = [subprocess.Popen(command(), env=variables(NUMBA_CACHE_DIR=folder), stdout=subprocess.PIPE, text=True)
               for _ in range(PROCESSES)]
    answers = [process.communicate(timeout=300)[0].strip() for process in running]
    assert all(process.returncode == 0 for process in running)
    assert {answer.split()[0] for answer in answers} == {'50.0'}
    assert run(command(), NUMBA_CACHE_DIR=folder) == LOADED
    assert not list(folder.rglob('*.tmp.*'))
    shown('eight processes compile into one cache at once', 'all answer, the cache is whole', '8 of 8')
