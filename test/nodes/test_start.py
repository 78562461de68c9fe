"""Signals before a node is there: while Python loads what it needs."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
from pathlib import Path

import pytest
from peers import TIMEOUT_S

MODULE = 'motion_detect_ros.nodes.pipeline'
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


def test_who_only_imports_a_node_keeps_his_signals():
    code = f'import signal, {MODULE}; print(signal.getsignal(signal.SIGINT) is signal.default_int_handler)'
    done = subprocess.run([sys.executable, '-c', code], capture_output=True, text=True, timeout=600, check=True)
    assert done.stdout == 'True\n'
