"""The launch files. ``launch`` has no wheels: their text is checked everywhere, their actions where it is installed."""

from __future__ import annotations

import ast
import os
import re
import runpy
from pathlib import Path
from typing import Any

import pytest

from motion_detect_ros.allocator import VARIABLES
from motion_detect_ros.bridge import topics
from motion_detect_ros.bridge.transport import PROFILE_VARIABLE
from motion_detect_ros.presets import NODE_PARAMETERS

REPOSITORY = Path(__file__).resolve().parents[2]
DETECT, REPLAY = (REPOSITORY / 'launch' / f'{name}.launch.py' for name in ('motion_detect', 'replay'))
#: What Nav2's bringup launch files take.
EXPECTED_BY_NAV2_USERS = {'namespace', 'use_sim_time', 'params_file', 'autostart', 'log_level', 'use_respawn'}


def constant(path: Path, name: str) -> Any:
    """Value of a module constant that is written out as a literal."""
    for node in ast.parse(path.read_text()).body:
        if isinstance(node, ast.Assign) and [getattr(target, 'id', '') for target in node.targets] == [name]:
            return ast.literal_eval(node.value)
    raise LookupError(f'{path.name}: no {name}')


def calls(path: Path, function: str) -> list[ast.Call]:
    return [node for node in ast.walk(ast.parse(path.read_text()))
            if isinstance(node, ast.Call) and getattr(node.func, 'id', '') == function]


def literals(nodes: list[ast.AST]) -> set[str]:
    return {each.value for node in nodes for each in ast.walk(node)
            if isinstance(each, ast.Constant) and isinstance(each.value, str)}


def keys_of_parameters(path: Path) -> set[str]:
    """Keys of all dicts in the file, and what is assigned into one: the names of node parameters."""
    tree = ast.parse(path.read_text())
    written = {key.value for node in ast.walk(tree) if isinstance(node, ast.Dict) for key in node.keys if key}
    return written | {node.slice.value for node in ast.walk(tree)
                      if isinstance(node, ast.Subscript) and isinstance(node.ctx, ast.Store)}


def test_arguments_are_those_that_nav2_users_expect_and_all_are_explained():
    arguments = constant(DETECT, 'ARGUMENTS')
    assert {name for name, _, _ in arguments} >= EXPECTED_BY_NAV2_USERS
    assert all(isinstance(default, str) and text for _, default, text in (*arguments, *constant(REPLAY, 'OWN')))


def test_what_is_read_was_declared():
    declared = {name for name, _, _ in constant(DETECT, 'ARGUMENTS')}
    read = set(re.findall(r"value\['(\w+)'\]|value\[\"(\w+)\"\]", DETECT.read_text()))
    assert {one or other for one, other in read} == declared
    own = {name for name, _, _ in constant(REPLAY, 'OWN')}
    taken = literals([argument for call in calls(REPLAY, 'LaunchConfiguration') for argument in call.args])
    assert taken <= own | declared
    assert 'namespace' in taken


def test_nodes_are_programs_of_the_package():
    programs = set(constant(REPOSITORY / 'setup.py', 'NODES'))
    started = {*constant(DETECT, 'STAGES'), *literals([call.args[0] for call in calls(DETECT, 'node')])}
    (player,) = calls(REPLAY, 'Node')
    started |= {keyword.value.value for keyword in player.keywords if keyword.arg == 'executable'}
    assert started >= {'ego_motion', 'optical_flow', 'art2_clustering', 'camera', 'overlay', 'bag_player'}
    assert started <= programs


def test_parameters_given_to_nodes_are_declared_by_them():
    given = keys_of_parameters(DETECT) | keys_of_parameters(REPLAY)
    assert {'source', 'autostart', 'bag', 'wait_for_subscribers'} <= given
    assert given - {'camera'} <= NODE_PARAMETERS  # camera is the argument that replay hands to the other file


def test_remapped_topics_are_topics_of_the_nodes():
    known = {value.name for value in vars(topics).values() if isinstance(value, topics.Topic)}
    remapped = {pair.elts[0].value for node in ast.walk(ast.parse(DETECT.read_text()))
                if isinstance(node, ast.Assign) and getattr(node.targets[0], 'id', '') == 'topics'
                for pair in node.value.elts}
    assert remapped == {'image_raw', 'image_raw/compressed', 'camera_info'}
    assert remapped <= known


def test_arguments_passed_on_are_declared_there():
    include, = calls(REPLAY, 'IncludeLaunchDescription')
    words = {keyword.arg: keyword.value for keyword in include.keywords}
    passed = ast.literal_eval(words['launch_arguments'].func.value)
    assert set(passed) <= {name for name, _, _ in constant(DETECT, 'ARGUMENTS')}
    assert passed['camera'] == 'false'


def test_the_transport_environment_is_set_whole():
    assert {PROFILE_VARIABLE, *VARIABLES} <= literals([ast.parse(DETECT.read_text())])


def actions(path: Path, **arguments: str) -> tuple[list[Any], dict[str, str]]:
    """The Node actions of a launch file, and the environment that it makes, by the real ``launch``."""
    nodes = pytest.importorskip('launch_ros.actions', reason='launch_ros is not installed (it has no wheels)').Node
    launch = pytest.importorskip('launch')
    context = launch.LaunchContext()
    context.launch_configurations.update(arguments)
    found: list[Any] = []

    def visit(entity: Any) -> None:
        if isinstance(entity, nodes):
            found.append(entity)
            return
        for each in entity.visit(context) or ():
            visit(each)

    visit(runpy.run_path(str(path))['generate_launch_description']())
    return found, dict(context.environment)


@pytest.mark.parametrize(('arguments', 'wanted'), [
    ({}, ['ego_motion', 'optical_flow', 'art2_clustering', 'camera', 'overlay']),
    ({'mode': 'pipeline', 'overlay': 'false'}, ['pipeline', 'camera']),
    ({'camera': 'false'}, ['ego_motion', 'optical_flow', 'art2_clustering', 'overlay']),
])
def test_detector_starts_what_the_arguments_ask(arguments: dict[str, str], wanted: list[str],
                                               monkeypatch: pytest.MonkeyPatch):
    monkeypatch.setattr(os, 'environ', dict(os.environ))
    found, environment = actions(DETECT, **arguments)
    assert [node.node_executable for node in found] == wanted
    assert environment[PROFILE_VARIABLE].endswith('.xml')


def test_replay_starts_detector_and_player(monkeypatch: pytest.MonkeyPatch):
    monkeypatch.setattr(os, 'environ', dict(os.environ))
    found, _ = actions(REPLAY, bag='flight.mcap', overlay='false')
    assert [node.node_executable for node in found] == ['ego_motion', 'optical_flow', 'art2_clustering', 'bag_player']
