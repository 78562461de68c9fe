"""Signals before a node is there: while Python loads what it needs."""

from __future__ import annotations

import os
import random
import re
import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest
from peers import TIMEOUT_S, small

pytestmark = pytest.mark.messages

MODULE = 'motion_detect_ros.nodes.pipeline'
#: A node is up after this on an idle machine; between two signals of one Ctrl-C, seconds.
LONGEST_S, SHORT_S = 5.0, 0.05
SCRIPT = f'import sys\nfrom {MODULE} import main\nsys.exit(main())\n'


@pytest.mark.parametrize('stop', [signal.SIGINT, signal.SIGTERM], ids=['SIGINT', 'SIGTERM'])
@pytest.mark.parametrize('last_loaded', ['motion_detect_ros.nodes', 'numba', 'rclpy.lifecycle'])
@pytest.mark.parametrize('kind', ['module', 'script'])
def test_quiet_end_while_python_imports(kind: str, last_loaded: str, stop: signal.Signals, tmp_path: Path):
    """``-X importtime`` tells on stderr what has just been loaded."""
    (tmp_path / 'pipeline').write_text(SCRIPT)
    program = ['-m', MODULE] if kind == 'module' else [str(tmp_path / 'pipeline')]
    process = subprocess.Popen([sys.executable, '-X', 'importtime', *program], stderr=subprocess.PIPE, text=True,
                               env={**os.environ, 'ROS_AUTOMATIC_DISCOVERY_RANGE': 'LOCALHOST'})
    for line in process.stderr:
        if line.rpartition('|')[2].strip() == last_loaded:
            process.send_signal(stop)
            break
    else:
        pytest.fail(f'{last_loaded} was never loaded')
    words = [line for line in process.stderr if not line.startswith('import time:')]
    assert (process.wait(TIMEOUT_S), words) == (0, [])


@pytest.mark.parametrize('stop', [signal.SIGINT, signal.SIGTERM], ids=['SIGINT', 'SIGTERM'])
def test_quiet_end_while_kernels_are_compiled(stop: signal.Signals, start, tmp_path: Path, monkeypatch):
    """ros2 launch waits 15 s before it kills; the compilation takes far longer on the machines of most drones."""
    monkeypatch.setenv('NUMBA_CACHE_DIR', str(tmp_path / 'cache'))
    process, log = start('pipeline', *small()), tmp_path / 'pipeline.log'
    await_words(process, log, 'compiling kernel 1;')
    process.send_signal(stop)
    assert process.wait(TIMEOUT_S) == 0
    assert 'configured' not in log.read_text()


@pytest.mark.parametrize('count', [1, 2])
def test_quiet_end_at_any_moment(count: int, start, tmp_path: Path):
    """From the first module on until images come: one signal, or those of a terminal and of ros2 launch."""
    chance = random.Random(count)
    for node in ('pipeline', 'overlay', 'optical_flow', 'art2_clustering', 'pipeline'):
        process = start(node, *small())
        while not catches(process.pid, signal.SIGTERM):
            time.sleep(0.001)
        time.sleep(chance.uniform(0.0, LONGEST_S))
        for _ in range(count):
            process.send_signal(signal.SIGINT)
            time.sleep(chance.uniform(0.0, SHORT_S))
        process.wait(TIMEOUT_S)


def catches(pid: int, number: signal.Signals) -> bool:
    """Whether a process has a handler for a signal: proc(5), SigCgt."""
    status = Path(f'/proc/{pid}/status').read_text()
    return bool(int(re.search(r'SigCgt:\s*(\w+)', status)[1], 16) >> (number - 1) & 1)


def await_words(process: subprocess.Popen[bytes], log: Path, words: str) -> None:
    deadline = time.monotonic() + TIMEOUT_S
    while words not in log.read_text():
        assert process.poll() is None, log.read_text()
        assert time.monotonic() < deadline, log.read_text()
        time.sleep(0.05)


def test_who_only_imports_a_node_keeps_his_signals():
    code = f'import signal, {MODULE}; print(signal.getsignal(signal.SIGINT) is signal.default_int_handler)'
    done = subprocess.run([sys.executable, '-c', code], capture_output=True, text=True, timeout=600, check=True)
    assert done.stdout == 'True\n'
