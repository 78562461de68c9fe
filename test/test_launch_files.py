"""The launch files, as far as they can be held against the rest without the launch package, which has no wheels."""

from __future__ import annotations

import ast
import os
from pathlib import Path
from typing import Any
from xml.etree import ElementTree

import pytest
from test_packaging import NODES

from motion_detect_ros.bridge.transport import PROFILE_VARIABLE, environment
from motion_detect_ros.presets import NODE_PARAMETERS, find_config

LAUNCH = Path(__file__).resolve().parent.parent / 'launch'
FILES = {path.name: ast.parse(path.read_text(encoding='utf-8')) for path in LAUNCH.glob('*.launch.py')}
DETECTOR, REPLAY = FILES['motion_detect.launch.py'], FILES['replay.launch.py']


def literal(tree: ast.Module, name: str) -> Any:
    """Value of a module constant."""
    for node in ast.walk(tree):
        if isinstance(node, ast.Assign) and getattr(node.targets[0], 'id', '') == name:
            return ast.literal_eval(node.value)
    raise LookupError(name)


def calls(tree: ast.Module, function: str) -> list[ast.Call]:
    return [n for n in ast.walk(tree) if isinstance(n, ast.Call) and getattr(n.func, 'id', '') == function]


DECLARED = {name for name, _, _ in literal(DETECTOR, 'ARGUMENTS')}
DECLARED_BY_REPLAY = {name for name, _, _ in literal(REPLAY, 'OWN')}


def test_files_are_found():
    assert set(FILES) == {'motion_detect.launch.py', 'replay.launch.py'}


def test_arguments_that_nav2_users_expect():
    assert {'namespace', 'use_sim_time', 'params_file', 'autostart', 'log_level', 'use_respawn'} <= DECLARED
    assert not DECLARED & DECLARED_BY_REPLAY


@pytest.mark.parametrize('name', sorted(FILES))
def test_every_configuration_used_is_declared(name: str):
    used = {call.args[0].value for call in calls(FILES[name], 'LaunchConfiguration')
            if isinstance(call.args[0], ast.Constant)}
    used |= {n.slice.value for n in ast.walk(FILES[name]) if isinstance(n, ast.Subscript)
             and getattr(n.value, 'id', '') == 'value' and isinstance(n.slice, ast.Constant)}
    assert used
    assert used <= DECLARED | DECLARED_BY_REPLAY


def test_defaults_and_descriptions_are_text():
    for name, default, text in (*literal(DETECTOR, 'ARGUMENTS'), *literal(REPLAY, 'OWN')):
        assert isinstance(name, str) and isinstance(default, str), name
        assert text, name


def test_every_node_started_is_installed():
    started = set(literal(DETECTOR, 'STAGES'))
    started |= {call.args[0].value for call in calls(DETECTOR, 'node') if isinstance(call.args[0], ast.Constant)}
    for call in calls(REPLAY, 'Node'):
        words = {keyword.arg: keyword.value for keyword in call.keywords}
        assert words['package'].value == 'motion_detect_ros'
        started.add(words['executable'].value)
    assert {'ego_motion', 'optical_flow', 'art2_clustering', 'camera', 'overlay', 'bag_player'} <= started <= set(NODES)


def test_parameters_of_the_player_are_ones_it_has():
    mapping, = (node.value for node in ast.walk(REPLAY) if isinstance(node, ast.Assign)
                and getattr(node.targets[0], 'id', '') == 'given')
    given = {ast.literal_eval(key) for key in mapping.keys}
    assert given <= NODE_PARAMETERS
    assert given == DECLARED_BY_REPLAY


def test_included_arguments_are_declared_there():
    include, = calls(REPLAY, 'IncludeLaunchDescription')
    words = {keyword.arg: keyword.value for keyword in include.keywords}
    passed = ast.literal_eval(words['launch_arguments'].func.value)
    assert set(passed) <= DECLARED
    assert passed['camera'] == 'false'


def test_transport_environment_is_the_one_of_the_package():
    ours = set(environment()) - set(os.environ)
    assert set(literal(DETECTOR, 'ours')) >= ours
    assert PROFILE_VARIABLE in literal(DETECTOR, 'ours')


def test_profile_holds_a_whole_image_in_shared_memory():
    """Fast DDS 2.14: XML in its name space, SHM of 32 MB or more and UDP, built-in transports off."""
    name_space = '{http://www.eprosima.com/XMLSchemas/fastRTPS_Profiles}'
    root = ElementTree.parse(find_config('fastdds_profile.xml')).getroot()
    assert root.tag == f'{name_space}profiles'
    transports = {t.findtext(f'{name_space}transport_id'): t for t in root.iter(f'{name_space}transport_descriptor')}
    kinds = {t.findtext(f'{name_space}type') for t in transports.values()}
    assert kinds == {'SHM', 'UDPv4'}
    shared, = (t for t in transports.values() if t.findtext(f'{name_space}type') == 'SHM')
    assert int(shared.findtext(f'{name_space}segment_size')) >= 32 * 2**20
    assert int(shared.findtext(f'{name_space}maxMessageSize')) >= 1920 * 1080 * 3
    participant = root.find(f'{name_space}participant')
    assert participant.get('is_default_profile') == 'true'
    used = {e.text for e in participant.iter(f'{name_space}transport_id')}
    assert used == set(transports)
    assert participant.findtext(f'.//{name_space}useBuiltinTransports') == 'false'
