"""Nodes as processes under measurement: start, memory, clean end."""

from __future__ import annotations

import os
import shutil
import signal
import subprocess
import sys
import tempfile
from pathlib import Path

from motion_detect_ros.bridge.transport import environment
from motion_detect_ros.cli.domains import lock_of
from motion_detect_ros.core.errors import SourceError

STOP_TIMEOUT_S = 10.0
KILOBYTES_PER_MEGABYTE = 1024.0


class NodeProcesses:
    """Runs ``nodes``, each in a process of its own, with the shipped transport; use as a context manager.

    parameters: ``name:=value`` or a parameter file for every node; variables: further environment; namespace: of all.
    """

    def __init__(
        self, nodes: tuple[str, ...], domain_id: int, parameters: tuple[str, ...] = (),
        variables: dict[str, str] | None = None, namespace: str = '',
    ) -> None:
        self._nodes, self._arguments = nodes, ['-r', f'__ns:=/{namespace}']
        for parameter in parameters:
            self._arguments += ['-p' if ':=' in parameter else '--params-file', parameter]
        self._lock = lock_of(domain_id)
        self._log = Path(tempfile.mkdtemp(prefix='motion_detect_'))
        self._environment = {
            **environment(), 'ROS_DOMAIN_ID': str(domain_id), 'ROS_AUTOMATIC_DISCOVERY_RANGE': 'LOCALHOST',
            'ROS_HOME': str(self._log), **(variables or {})}
        self._running: dict[str, subprocess.Popen[bytes]] = {}

    def __enter__(self) -> NodeProcesses:
        try:
            for node in self._nodes:
                self._start(node)
        except BaseException:  # Ctrl-C too
            self.__exit__()
            raise
        return self

    def _start(self, node: str) -> None:
        command = [sys.executable, '-m', f'motion_detect_ros.nodes.{node}', '--ros-args', *self._arguments]
        with (self._log / f'{node}.txt').open('wb') as log:
            self._running[node] = subprocess.Popen(command, env=self._environment, stdout=log, stderr=subprocess.STDOUT,
                                                   pass_fds=self._lock)

    def __exit__(self, *_: object) -> None:
        for process in self._running.values():
            if process.poll() is None:
                process.send_signal(signal.SIGINT)
        for process in self._running.values():
            try:
                process.wait(STOP_TIMEOUT_S)
            except subprocess.TimeoutExpired:
                process.kill()
                process.wait()
        shutil.rmtree(self._log, ignore_errors=True)

    def check(self) -> None:
        """Raises: SourceError where a node has ended, with what it printed."""
        for node, process in self._running.items():
            if process.poll() is not None:
                printed = (self._log / f'{node}.txt').read_text(encoding='utf-8', errors='replace').strip()
                raise SourceError(f'{node}: ended with exit code {process.poll()}: {printed}')

    def kill_and_restart(self, node: str) -> None:
        """As a crash and ``respawn`` of the launch file: SIGKILL, and the same again."""
        self._running[node].kill()
        self._running[node].wait()
        self._start(node)

    def threads(self, node: str) -> int:
        """Threads of a node."""
        return len(list(Path(f'/proc/{self._running[node].pid}/task').iterdir()))

    def handles(self, node: str) -> int:
        """Open file descriptors of a node."""
        return len(list(Path(f'/proc/{self._running[node].pid}/fd').iterdir()))

    def memory_mb(self, node: str) -> float:
        """Resident memory of a node, megabytes. Raises: SourceError where the system does not provide it."""
        return resident_mb(self._running[node].pid)

    def cpu_s(self, node: str) -> float:
        """Processor time that a node has used, seconds."""
        return cpu_s(self._running[node].pid)


def cpu_s(pid: int) -> float:
    """Processor time that a process has used, seconds."""
    fields = Path(f'/proc/{pid}/stat').read_text(encoding='ascii').rsplit(')', 1)[1].split()
    return (int(fields[11]) + int(fields[12])) / os.sysconf('SC_CLK_TCK')


def resident_mb(pid: int) -> float:
    """Resident memory of a process, megabytes. Raises: SourceError where the system does not provide it."""
    try:
        status = Path(f'/proc/{pid}/status').read_text(encoding='ascii')
    except OSError as error:
        raise SourceError(f'process {pid}: expected /proc/{pid}/status, got {error.strerror}') from None
    kilobytes = next((line.split()[1] for line in status.splitlines() if line.startswith('VmRSS:')), None)
    if kilobytes is None:
        raise SourceError(f'process {pid}: has ended')
    return round(int(kilobytes) / KILOBYTES_PER_MEGABYTE, 1)
