"""Parameters of running nodes: which there are, what may change, and that what is dumped is a preset."""

from __future__ import annotations

import re
from pathlib import Path

import cv2
import numpy as np
import pytest
import yaml
from lifecycle_msgs.msg import Transition
from lifecycle_msgs.srv import ChangeState
from peers import Peer, image_message, picture, ready, set_parameters, small
from rcl_interfaces.srv import GetParameters, ListParameters, SetParametersAtomically
from rclpy.parameter import Parameter, parameter_value_to_python
from sensor_msgs.msg import Image, PointCloud2

from motion_detect_ros.bridge.records import ego_from_msg, read_detections
from motion_detect_ros.core.types import EgoStatus
from motion_detect_ros.presets import load_preset

CONFIG = Path(__file__).resolve().parents[2] / 'config'
#: Nodes, and the first words of the names of the settings that each declares.
SECTIONS = {
    'ego_motion': {'preprocessing', 'ego_motion', 'imu', 'background', 'load'},
    'optical_flow': {'preprocessing', 'optical_flow', 'load'},
    'art2_clustering': {
        'preprocessing', 'optical_flow', 'background', 'art2', 'objects', 'trajectories', 'tracks', 'load',
        'self_tuning'},
    'camera': set(), 'overlay': set(),
}


@pytest.mark.parametrize('node', SECTIONS)
def test_a_node_declares_what_it_uses_and_warns_of_misspelt_names_only(node, peer, start, tmp_path):
    """One file serves all nodes, so that what others use is no mistake."""
    file, log = tmp_path / 'mine.yaml', tmp_path / f'{node}.log'
    file.write_text(f'/**: {{ros__parameters: {{bag: a.mcap, sorce: x, source: {tmp_path}, autostart: false, '
                    'art2: {vigilanse: 0.2}}}\n')
    start(node, '--params-file', str(CONFIG / 'default.yaml'), '--params-file', str(file))
    names = peer.call(ListParameters, f'/{node}/list_parameters').result.names
    assert {name.split('.')[0] for name in names if '.' in name and 'qos' not in name} == SECTIONS[node]
    cv2.imwrite(str(tmp_path / '0.png'), picture(0))
    assert peer.call(ChangeState, f'/{node}/change_state', transition=Transition(label='configure')).success
    warned = dict(re.findall(r'parameter (\S+) is unknown and has no effect(.*)', log.read_text()))
    used = {'art2.vigilanse': '; did you mean art2.vigilance?'}  # of another node, too: the file is for all of them
    assert warned == {'sorce': '; did you mean source?' if node == 'camera' else '', **used}


def dump(peer: Peer, node: str) -> dict[str, object]:
    """What ros2 param dump asks a node for."""
    names = peer.call(ListParameters, f'/{node}/list_parameters').result.names
    values = peer.call(GetParameters, f'/{node}/get_parameters', names=names).values
    return {name: parameter_value_to_python(value) for name, value in zip(names, values, strict=True)}


def test_settings_change_between_images_and_history_stays_unless_it_cannot(peer, start, tmp_path):
    start('pipeline', *small())
    answers, egos = peer.subscribe(PointCloud2, 'detections'), peer.subscribe(PointCloud2, 'ego_motion')
    publisher = peer.advertise(Image, 'image_raw')
    assert ready(peer, 'image_raw')

    def show(images: int) -> np.ndarray:
        for count in range(len(answers), len(answers) + images):
            publisher.publish(image_message(count))
            assert peer.until(lambda count=count: len(answers) > count and len(egos) > count)
        return read_detections(answers[-1])['id']

    seen = show(12)
    assert len(seen) == 1
    assert set_parameters(peer, 'pipeline', tracks__show_log_odds=100, art2__vigilance=0.3) == ['', '']
    assert len(show(1)) == 0
    assert set_parameters(peer, 'pipeline', tracks__show_log_odds=0.0) == ['']
    assert seen[0] in show(1)  # the track went on
    assert ego_from_msg(egos[-1]).status == EgoStatus.OK
    log = tmp_path / 'pipeline.log'
    assert 'history is cleared' not in log.read_text()

    assert set_parameters(peer, 'pipeline', optical_flow__baseline_s=0.1) == ['']
    assert 'optical_flow.baseline_s changed: history is cleared' in log.read_text()
    assert len(show(1)) == 0
    assert ego_from_msg(egos[-1]).status == EgoStatus.FIRST_FRAME
    later = show(12)
    assert len(later) == 1
    assert later[0] > seen[0]  # no id is used twice


def test_what_cannot_be_is_refused_with_the_reason_and_changes_nothing(peer, start, tmp_path):
    start('pipeline', *small())
    before = dump(peer, 'pipeline')
    reasons = set_parameters(
        peer, 'pipeline', art2__vigilance=2.0, art2__max_neurons=3, ego_motion__smoothing='magic', load__threads=1,
        tracks__confirm_s='long')
    for reason, words in zip(reasons, (
            'art2.vigilance', r'art2.initial_neurons: expected at most art2.max_neurons \(3\), got 15',
            "ego_motion.smoothing: expected one of kalman, autoregressive, none, got 'magic'", 'read-only|read_only',
            'tracks.confirm_s|type'), strict=True):
        assert re.search(words, reason), (words, reason)
    assert dump(peer, 'pipeline') == before
    together = [Parameter('art2.max_neurons', value=3), Parameter('art2.initial_neurons', value=2)]
    assert peer.call(SetParametersAtomically, '/pipeline/set_parameters_atomically',
                     parameters=[each.to_parameter_msg() for each in together]).result.successful
    file = tmp_path / 'dump.yaml'
    file.write_text(yaml.safe_dump({'/pipeline': {'ros__parameters': dump(peer, 'pipeline')}}))
    preset = load_preset(file)
    assert (preset.art2.max_neurons, preset.art2.initial_neurons) == (3, 2)
    assert (preset.preprocessing.max_width_px, preset.tracks) == (320, load_preset('default').tracks)
