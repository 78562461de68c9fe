"""Presets say what the dataclasses say, and wrong files are named in one line."""

from __future__ import annotations

import re
from pathlib import Path

import pytest

from motion_detect_ros.core.config import PipelineConfig
from motion_detect_ros.core.errors import ConfigError
from motion_detect_ros.core.settings import settings, with_settings
from motion_detect_ros.presets import (
    NODE_PARAMETERS,
    are_rectified,
    find_config,
    load_preset,
    node_sections,
    preset_names,
    read_parameters,
    value_for,
    write_preset,
)


def test_default_yaml_is_every_default():
    written = read_parameters(find_config('default.yaml'))
    assert written == {name: value for name, value, _ in settings(PipelineConfig())}
    assert load_preset('default') == PipelineConfig()


@pytest.mark.parametrize('name', ['default', 'kitti', 'report', 'visdrone'])
def test_presets_hold_known_parameters_only(name):
    known = {setting for setting, _, _ in settings(PipelineConfig())} | NODE_PARAMETERS
    assert set(read_parameters(find_config(f'{name}.yaml'))) <= known
    assert name in preset_names()


def test_every_parameter_that_a_node_declares_may_stand_in_a_preset():
    package = find_config('default.yaml').parent.parent / 'motion_detect_ros'
    sources = '\n'.join(path.read_text() for folder in ('nodes', 'bridge') for path in (package / folder).glob('*.py'))
    declared = set(re.findall(r"declare_(?:simple|address)\(\s*(?:self|node), '(\w+)'", sources))
    assert {'bag', 'image_reliability', 'queue_size', 'source', 'first_id'} <= declared
    assert declared | {'use_sim_time', 'start_type_description_service'} == NODE_PARAMETERS  # the last two are rclpy's


def test_published_values_are_shipped():
    visdrone, kitti = load_preset('visdrone').art2, load_preset('kitti').art2
    assert (visdrone.initial_neurons, visdrone.max_neurons, visdrone.vigilance, visdrone.learning_rate) == (
        15, 25, 0.2, 0.95)
    assert (kitti.initial_neurons, kitti.max_neurons, kitti.learning_rate) == (5, 10, 0.95)


def test_node_parameters_are_left_out_offline(tmp_path: Path):
    path = tmp_path / 'mine.yaml'
    path.write_text('/**:\n  ros__parameters:\n    queue_size: 3\n    art2: {vigilance: 0.3}\n')
    assert load_preset(path).art2.vigilance == 0.3


def test_quality_of_service_is_left_out_offline(tmp_path: Path):
    path = tmp_path / 'mine.yaml'
    path.write_text('/**:\n  ros__parameters:\n    art2: {vigilance: 0.3}\n'
                    '    qos_overrides: {/image_raw: {subscription: {depth: 3}}}\n'
                    '    qos_overrides./imu.subscription.reliability: reliable\n')
    assert load_preset(path) == with_settings(PipelineConfig(), {'art2.vigilance': 0.3})


def test_a_preset_is_written_with_the_parameters_of_the_nodes(tmp_path: Path):
    start, written = tmp_path / 'start.yaml', tmp_path / 'written.yaml'
    start.write_text('/**:\n  ros__parameters:\n    image_transport: compressed\n    queue_size: 12\n'
                     '    qos_overrides: {/image_raw: {subscription: {depth: 3}}}\n    topics: [/a, /b]\n'
                     '    art2: {vigilance: 0.25}\n    art2.max_neurons: 30\n')
    write_preset(written, load_preset(start), of_nodes=node_sections(start))
    assert read_parameters(written) == read_parameters(start)
    assert node_sections('visdrone') == {}


def test_what_one_node_only_reads_stays_its_own(tmp_path: Path):
    """Of a section for one node nothing becomes a parameter of the others."""
    start, written = tmp_path / 'start.yaml', tmp_path / 'written.yaml'
    start.write_text('camera: {ros__parameters: {queue_size: 30, autostart: false, source: /front.mp4}}\n'
                     '/**: {ros__parameters: {image_transport: compressed, queue_size: 8, trajectories: {use: true}}}\n'
                     'fleet: {rear: {camera: {ros__parameters: {queue_size: 5, source: /rear.mp4}}}}\n')
    write_preset(written, load_preset(start), of_nodes=node_sections(start))
    assert load_preset(written) == load_preset(start)
    for node in ('/camera', '/pipeline', '/fleet/rear/camera'):
        for name in ('queue_size', 'autostart', 'image_transport', 'source'):
            assert value_for(written, node, name) == value_for(start, node, name)
    assert value_for(written, '/camera', 'queue_size') == 8, 'the later one holds'
    assert value_for(written, '/pipeline', 'autostart') is None


def test_sections_of_several_nodes_are_taken_together_where_they_agree(tmp_path: Path):
    path = tmp_path / 'mine.yaml'
    path.write_text('/front/pipeline:\n  ros__parameters: {queue_size: 3, art2: {vigilance: 0.3}}\n'
                    '/rear/pipeline:\n  ros__parameters: {queue_size: 5, art2.vigilance: 0.3, art2.max_neurons: 30}\n')
    assert load_preset(path) == with_settings(PipelineConfig(), {'art2.vigilance': 0.3, 'art2.max_neurons': 30})
    assert node_sections(path) == {'/front/pipeline': {'queue_size': 3}, '/rear/pipeline': {'queue_size': 5}}
    assert are_rectified(path) is False, 'what differs and is not asked for does not matter'
    path.write_text(path.read_text().replace('art2.vigilance: 0.3', 'art2.vigilance: 0.25'))
    words = "mine.yaml: expected one value of art2.vigilance, got 0.3 under '/front/pipeline', 0.25 under '/rear/pipeli"
    with pytest.raises(ConfigError, match=re.escape(words)):
        load_preset(path)


@pytest.mark.parametrize(('text', 'words'), [
    ('art2: {vigilance: 0.3}', 'mine.yaml: expected "ros__parameters:" under'),
    ('just words', 'mine.yaml: expected "/\\*\\*: ros__parameters:" at the top, got str'),
    ('/**: [1', 'mine.yaml: expected a YAML parameter file, got'),
    (f'/**: {{ros__parameters: {"{a: " * 3000}1{"}" * 3000}}}', 'mine.yaml: expected a YAML parameter file, got one n'),
    ('/**: {ros__parameters: &all {art2: *all}}', 'mine.yaml: expected a YAML parameter file, got one nested too deep'),
    ('/**: {ros__parameters: {fps: 2026-13-01}}', 'mine.yaml: expected a YAML parameter file, got month must be in 1'),
    ('/**:\n  ros__parameters:\n    art2: {vigilanse: 0.3}', "mine.yaml: unknown setting 'art2.vigilanse'"),
    ('/**:\n  ros__parameters:\n    qos_override: 1', "mine.yaml: unknown setting 'qos_override'"),
    ('/**:\n  ros__parameters:\n    art2: {vigilance: 3.0}', 'mine.yaml: art2.vigilance: expected 0.0 to 1.0, got 3.0'),
])
def test_wrong_files_are_named_in_one_line(tmp_path: Path, text: str, words: str):
    path = tmp_path / 'mine.yaml'
    path.write_text(text)
    with pytest.raises(ConfigError, match=words) as caught:
        load_preset(path)
    assert '\n' not in str(caught.value)


def test_unknown_presets_list_the_known_ones():
    words = r'moon: expected a preset \(default, kitti, report, visdrone\) or a YAML file'
    with pytest.raises(ConfigError, match=words):
        load_preset('moon')


@pytest.mark.parametrize(('values', 'words'), [
    ({'art2.initial_neurons': 30}, r'art2.initial_neurons: expected at most art2.max_neurons \(25\), got 30'),
    ({'tracks.confirm_s': 0.5}, r'tracks.confirm_s: expected at most tracks.confirm_window_s \(0.24\), got 0.5'),
])
def test_settings_that_contradict_each_other_are_refused(values: dict[str, int], words: str):
    with pytest.raises(ConfigError, match=words):
        with_settings(PipelineConfig(), values)


def test_settings_are_checked_together_not_one_by_one():
    config = with_settings(PipelineConfig(), {'art2.initial_neurons': 30, 'art2.max_neurons': 40})
    assert (config.art2.initial_neurons, config.art2.max_neurons) == (30, 40)


@pytest.mark.parametrize(('node', 'expected'), [
    ('/camera', 1), ('robot1/camera', 4), ('/robot1/overlay', 2), ('/robot2/rear/camera', 3), ('/robot2/camera', 5),
    ('/robot3', 6)])
def test_the_last_section_that_matches_a_node_holds(node: str, expected: int, tmp_path: Path):
    """The values are those that nodes of rclpy 7.1 took from this file."""
    path = tmp_path / 'mine.yaml'
    path.write_text("""
/**: {ros__parameters: {source: 1}}
/robot1/*: {ros__parameters: {source: 2}}
/robot2/**: {ros__parameters: {source: 3}}
/robot1/camera: {ros__parameters: {source: 4, rate: 1.0}}
robot2:
  camera: {ros__parameters: {source: 5}}
/robot3: {ros__parameters: {source: 6}}
""")
    assert value_for(path, node, 'source') == expected
    assert value_for(path, node, 'rate') == (1.0 if expected == 4 else None)


def test_an_empty_file_says_nothing_about_a_node(tmp_path: Path):
    path = tmp_path / 'empty.yaml'
    path.touch()
    assert value_for(path, '/camera', 'source') is None


@pytest.mark.parametrize(('value', 'meant'), [('true', True), ('false', False)])
def test_rectified_is_true_or_false(tmp_path: Path, value: str, meant: bool) -> None:
    path = tmp_path / 'mine.yaml'
    path.write_text(f'/**: {{ros__parameters: {{rectified: {value}}}}}')
    assert are_rectified(path) is meant
    assert are_rectified('visdrone') is False


def test_cameras_that_are_rectified_and_not_are_told_apart(tmp_path: Path) -> None:
    path = tmp_path / 'mine.yaml'
    path.write_text('/front/pipeline: {ros__parameters: {rectified: true}}\n'
                    '/rear/pipeline: {ros__parameters: {rectified: false}}\n')
    words = "mine.yaml: expected one value of rectified, got True under '/front/pipeline', False under '/rear/pipeline'"
    with pytest.raises(ConfigError, match=re.escape(words)):
        are_rectified(path)


@pytest.mark.parametrize(('value', 'shown'), [('"true"', "'true'"), ('1', '1'), ('yess', "'yess'")])
def test_rectified_of_another_type_is_refused(tmp_path: Path, value: str, shown: str) -> None:
    """The node would refuse it too; taken for false, the calibration would be another one without a word."""
    path = tmp_path / 'mine.yaml'
    path.write_text(f'/**: {{ros__parameters: {{rectified: {value}}}}}')
    with pytest.raises(ConfigError, match=f'mine.yaml: rectified: expected true or false, got {shown}'):
        are_rectified(path)
