"""Nodes as processes of their own."""

from __future__ import annotations

import signal
import subprocess
import sys
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import pytest
import rclpy
from peers import TIMEOUT_S, Peer

from motion_detect_ros.bridge.transport import environment
from motion_detect_ros.cli.domains import lock_of, own_domain


@pytest.fixture
def peer(monkeypatch: pytest.MonkeyPatch) -> Iterator[Peer]:
    """With the transport profile that the package ships."""
    for name, value in environment().items():
        monkeypatch.setenv(name, value)
    monkeypatch.setenv('ROS_AUTOMATIC_DISCOVERY_RANGE', 'LOCALHOST')
    one = Peer(own_domain())
    yield one
    one.close()


@pytest.fixture
def start(tmp_path: Path) -> Iterator[Callable[..., subprocess.Popen[bytes]]]:
    """``start(node, *ros_arguments)`` runs a node as a process; every one must end cleanly, with its ``code``."""
    running: list[tuple[subprocess.Popen[bytes], Path, int]] = []

    def begin(node: str, *arguments: str, code: int = 0) -> subprocess.Popen[bytes]:
        variables = {**environment(), 'ROS_DOMAIN_ID': str(own_domain()), 'ROS_AUTOMATIC_DISCOVERY_RANGE': 'LOCALHOST',
                     'ROS_HOME': str(tmp_path)}
        log = tmp_path / f'{node}.log'
        command = [sys.executable, '-m', f'motion_detect_ros.nodes.{node}', '--ros-args', *arguments]
        with log.open('wb') as output:
            process = subprocess.Popen(command, env=variables, stdout=output, stderr=subprocess.STDOUT,
                                       pass_fds=lock_of(own_domain()))
        running.append((process, log, code))
        return process

    yield begin
    for process, _, _ in running:
        if process.poll() is None:
            process.send_signal(signal.SIGINT)
    for process, log, expected in running:
        try:
            code = process.wait(TIMEOUT_S)
        except subprocess.TimeoutExpired:
            process.kill()
            raise
        printed = log.read_text(errors='replace')
        print(f'{log.name}: {printed}')  # shown where the test has failed
        assert code == expected, printed
        assert 'Traceback' not in printed, printed


@pytest.fixture
def here() -> Iterator[Callable[..., Any]]:
    """``here(kind, *parameters)``: a node in this process, active."""
    nodes: list[Any] = []

    def make(kind: type, *parameters: str) -> Any:
        rclpy.init(args=['--ros-args', *(word for each in parameters for word in ('-p', each))],
                   domain_id=own_domain())
        nodes.append(kind())
        nodes[-1].start()
        return nodes[-1]

    yield make
    for node in nodes:
        node.close()
        node.destroy_node()  # else it would go on being seen by the next test
    rclpy.try_shutdown()
