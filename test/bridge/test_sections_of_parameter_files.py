"""Sections of a ROS parameter file that match a node: offline takes what rclpy gives the node."""

from __future__ import annotations

import re
from pathlib import Path
from typing import Any

import pytest
import rclpy
from rclpy.context import Context

from motion_detect_ros.cli.domains import own_domain
from motion_detect_ros.core.errors import ConfigError
from motion_detect_ros.core.settings import settings
from motion_detect_ros.presets import are_rectified, load_preset, node_sections, write_preset

ALL = '/**: {ros__parameters: {art2: {vigilance: 0.3}, tracks.coast_s: 0.5, rectified: false}}\n'
PIPELINE = 'pipeline: {ros__parameters: {art2.vigilance: 0.2, rectified: true}}\n'
#: File, and what it says of art2.vigilance, tracks.coast_s and rectified by the rule "the last section that matches".
FILES = {
    'all, then the node': (f'{ALL}/{PIPELINE}', 0.2, 0.5, True),
    'without a slash': (ALL + PIPELINE, 0.2, 0.5, True),
    'the node, then all': (f'/{PIPELINE}{ALL}', 0.3, 0.5, False),
    'all of the root, then the node': (f'{ALL.replace("/**", "/*")}/{PIPELINE}', 0.2, 0.5, True),
    'another node too': (f'{ALL}/camera: {{ros__parameters: {{fps: 10.0}}}}\n/{PIPELINE}', 0.2, 0.5, True),
    'all, the node, and all again': (f'{ALL}/{PIPELINE}"/*": {{ros__parameters: {{tracks.coast_s: 0.25}}}}\n',
                                     0.2, 0.25, True),
    'another node, all, then the node': (f'/camera: {{ros__parameters: {{tracks.coast_s: 0.1}}}}\n{ALL}'
                                         '/pipeline: {ros__parameters: {tracks.coast_s: 0.25}}\n', 0.3, 0.25, False),
}


def by_rclpy(path: Path, namespace: str = '') -> dict[str, Any]:
    """The parameters that rclpy finds for the node ``pipeline`` of a namespace."""
    context = Context()
    rclpy.init(args=[], context=context, domain_id=own_domain())
    try:
        node = rclpy.create_node(
            'pipeline', context=context, namespace=namespace, cli_args=['--ros-args', '--params-file', str(path)],
            automatically_declare_parameters_from_overrides=True, start_parameter_services=False, enable_rosout=False)
        found = {name: parameter.value for name, parameter in node.get_parameters_by_prefix('').items()}
        node.destroy_node()
        return found
    finally:
        context.try_shutdown()


@pytest.mark.parametrize(('text', 'vigilance', 'coast_s', 'rectified'), FILES.values(), ids=FILES)
def test_offline_and_ros_agree(tmp_path: Path, text: str, vigilance: float, coast_s: float, rectified: bool):
    path = tmp_path / 'mine.yaml'
    path.write_text(text)
    of_ros = by_rclpy(path)
    assert [of_ros[name] for name in ('art2.vigilance', 'tracks.coast_s', 'rectified')] == [
        vigilance, coast_s, rectified]
    offline = {name: value for name, value, _ in settings(load_preset(path))}
    assert (offline['art2.vigilance'], offline['tracks.coast_s']) == (vigilance, coast_s)
    assert are_rectified(path) is rectified


def test_nodes_that_differ_are_refused_beside_a_section_for_all(tmp_path: Path):
    path = tmp_path / 'mine.yaml'
    path.write_text(f'{ALL}/front/{PIPELINE}/rear/{PIPELINE.replace("0.2", "0.25")}')
    words = "expected one value of art2.vigilance, got 0.2 under '/front/pipeline', 0.25 under '/rear/pipeline'"
    with pytest.raises(ConfigError, match=re.escape(words)):
        load_preset(path)


@pytest.mark.parametrize(('text', 'vigilance', 'coast_s'), [
    (f'{ALL}drone1: {{{PIPELINE.strip()}}}\n', 0.2, 0.5),
    (f'{ALL}/drone1: {{{PIPELINE.strip()}}}\n', 0.2, 0.5),
    (f'{ALL}fleet: {{drone1: {{{PIPELINE.strip()}}}}}\n', 0.2, 0.5),
    (f'drone1: {{{PIPELINE.strip()}}}\n{ALL}', 0.3, 0.5),
], ids=['one deep', 'with a slash', 'two deep', 'all of them after it'])
def test_offline_reads_nested_namespaces_as_ros_does(tmp_path: Path, text: str, vigilance: float, coast_s: float):
    path = tmp_path / 'mine.yaml'
    path.write_text(text)
    of_ros = by_rclpy(path, '/fleet/drone1' if 'fleet' in text else '/drone1')
    assert [of_ros[name] for name in ('art2.vigilance', 'tracks.coast_s')] == [vigilance, coast_s]
    offline = {name: value for name, value, _ in settings(load_preset(path))}
    assert (offline['art2.vigilance'], offline['tracks.coast_s']) == (vigilance, coast_s)


@pytest.mark.parametrize(('text', 'words'), [
    (f'front: {{{PIPELINE.strip()}}}\nrear: {{{PIPELINE.replace("0.2", "0.25").strip()}}}\n',
     "expected one value of art2.vigilance, got 0.2 under 'front/pipeline', 0.25 under 'rear/pipeline'"),
    ('drone1: {pipeline: {tracks.coast_s: 0.2}}\n',
     'expected "ros__parameters:" under \'drone1/pipeline\', got tracks.coast_s'),
    ('drone1: {pipeline: {ros__parameters: 3}}\n', 'expected "ros__parameters:" under \'drone1/pipeline\''),
])
def test_errors_name_the_nested_node(tmp_path: Path, text: str, words: str):
    path = tmp_path / 'mine.yaml'
    path.write_text(text)
    with pytest.raises(ConfigError, match=re.escape(words)):
        load_preset(path)


def test_ros_finds_in_a_written_file_what_the_sections_said(tmp_path: Path):
    start, written = tmp_path / 'start.yaml', tmp_path / 'written.yaml'
    start.write_text(f'{ALL}fleet: {{drone1: {{{PIPELINE.strip()}}}}}\n'
                     '/other/pipeline: {ros__parameters: {fps: 3.0}}\n')
    write_preset(written, load_preset(start), of_nodes=node_sections(start))
    assert by_rclpy(written, '/fleet/drone1')['rectified'] is True
    assert by_rclpy(written)['rectified'] is False
    assert 'fps' not in by_rclpy(written)
