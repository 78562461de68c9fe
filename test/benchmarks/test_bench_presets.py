"""A file of settings under any name that other commands take reaches the measured nodes."""

from __future__ import annotations

from pathlib import Path

import pytest

pytest.importorskip('rclpy', reason='ROS 2 is not installed')

from motion_detect_ros.benchmarks.bench_nodes import NodeProcesses
from motion_detect_ros.benchmarks.bench_transport import parameters
from motion_detect_ros.benchmarks.node_interface import Inspector
from motion_detect_ros.cli.domains import own_domain


@pytest.mark.parametrize('name', ['mine.yml', 'mine.yaml', 'mine'])
def test_settings_of_a_file(name: str, tmp_path: Path) -> None:
    path = tmp_path / name
    path.write_text('/**: {ros__parameters: {art2: {max_neurons: 33}}}')
    settings = (*parameters(str(path)), 'autostart:=false')
    with (NodeProcesses(('art2_clustering',), own_domain(), settings, namespace='measured'),
          Inspector(own_domain(), 'measured') as inspector):
        assert inspector.parameters('art2_clustering')['art2.max_neurons'].value == 33
