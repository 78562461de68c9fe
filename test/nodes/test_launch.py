"""The launch files: by the real ``launch`` where it is installed (it has no wheels), by a small stand-in elsewhere."""

from __future__ import annotations

import ast
import importlib
import importlib.util
import os
import re
import runpy
import sys
from collections.abc import Callable, Iterator
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import pytest

from motion_detect_ros.allocator import VARIABLES
from motion_detect_ros.bridge import topics
from motion_detect_ros.bridge.transport import PROFILE_VARIABLE
from motion_detect_ros.core.errors import ConfigError, MotionDetectError, SourceError
from motion_detect_ros.launching import STAGES
from motion_detect_ros.presets import NODE_PARAMETERS

REPOSITORY = Path(__file__).resolve().parents[2]
DETECT, REPLAY, CAMERAS = (
    REPOSITORY / 'launch' / f'{name}.launch.py' for name in ('motion_detect', 'replay', 'cameras'))
STAND_IN = Path(__file__).with_name('launch_stand_in')
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


def test_arguments_are_those_that_nav2_users_expect_and_all_are_explained():
    arguments = constant(DETECT, 'ARGUMENTS')
    assert {name for name, _, _ in arguments} >= EXPECTED_BY_NAV2_USERS
    assert all(isinstance(default, str | None) and text for _, default, text in (*arguments, *constant(REPLAY, 'OWN')))


def test_what_is_read_was_declared():
    declared = {name for name, _, _ in constant(DETECT, 'ARGUMENTS')}
    read = set(re.findall(r"value\['(\w+)'\]|value\[\"(\w+)\"\]", DETECT.read_text()))
    assert {one or other for one, other in read} == declared
    own = {name for name, _, _ in constant(REPLAY, 'OWN')}
    taken = set(re.findall(r"value\['(\w+)'\]", REPLAY.read_text()))
    assert own | {'namespace', 'mode'} == taken


def test_nodes_are_programs_of_the_package():
    programs = set(constant(REPOSITORY / 'setup.py', 'NODES'))
    started = {*STAGES['nodes'], *STAGES['pipeline'], *literals([call.args[0] for call in calls(DETECT, 'node')])}
    (player,) = calls(REPLAY, 'Node')
    started |= {keyword.value.value for keyword in player.keywords if keyword.arg == 'executable'}
    assert started >= {'ego_motion', 'optical_flow', 'art2_clustering', 'camera', 'overlay', 'bag_player'}
    assert started <= programs


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


@pytest.fixture
def launched(monkeypatch: pytest.MonkeyPatch) -> Iterator[Callable[..., list[dict[str, Any]]]]:
    """``launched(path, **arguments)``: options of the nodes that a launch file starts.

    By the real launch where it is installed, by a stand-in that evaluates arguments alike elsewhere.
    """
    if importlib.util.find_spec('launch_ros') is None:
        monkeypatch.syspath_prepend(str(STAND_IN))
    launch, actions = importlib.import_module('launch'), importlib.import_module('launch_ros.actions')
    monkeypatch.setattr(os, 'environ', {name: value for name, value in os.environ.items()
                                        if name not in {PROFILE_VARIABLE, *VARIABLES}})

    def run(path: Path, **arguments: str) -> list[dict[str, Any]]:
        found: list[dict[str, Any]] = []

        class Recorded(actions.Node):
            def __init__(self, **options: Any) -> None:
                super().__init__(**options)
                found.append(options)

        monkeypatch.setattr(actions, 'Node', Recorded)
        context = launch.LaunchContext()
        context.launch_configurations.update(arguments)

        def visit(entity: Any) -> None:
            if not isinstance(entity, actions.Node):
                for each in entity.visit(context) or ():
                    visit(each)

        visit(runpy.run_path(str(path))['generate_launch_description']())
        return found

    yield run
    for name in [each for each in sys.modules if each.partition('.')[0] in {'launch', 'launch_ros'}]:
        del sys.modules[name]


def names(nodes: list[dict[str, Any]]) -> list[str]:
    assert {node['package'] for node in nodes} == {'motion_detect_ros'}
    return [node['executable'] for node in nodes]


def parameters(node: dict[str, Any]) -> dict[str, Any]:
    """Those that are written out, texts as texts."""
    return {name: getattr(value, 'value', value) for name, value in node['parameters'][-1].items()}


@pytest.mark.parametrize(('arguments', 'wanted'), [
    ({}, [*STAGES['nodes'], 'camera', 'overlay']),
    ({'mode': 'pipeline', 'overlay': 'False'}, ['pipeline', 'camera']),
    ({'camera': '0'}, [*STAGES['nodes'], 'overlay']),
])
def test_detector_starts_what_the_arguments_ask(arguments: dict[str, str], wanted: list[str], launched):
    assert names(launched(DETECT, **arguments)) == wanted


@pytest.mark.parametrize('true', ['true', 'True', 'TRUE', '1', 'yes', 'on'])
@pytest.mark.parametrize('false', ['false', 'False', '0', 'no', 'off'])
def test_flags_are_what_users_of_nav2_write(true: str, false: str, launched):
    stage, *_ = launched(DETECT, autostart=true, use_sim_time=true, image_transport='compressed', rectified=true,
                         use_respawn=true)
    given = parameters(stage)
    assert {name: given[name] for name in ('autostart', 'use_sim_time', 'image_transport', 'rectified')} == {
        'autostart': True, 'use_sim_time': True, 'image_transport': 'compressed', 'rectified': True}
    assert stage['respawn'] is True
    stage, *_ = launched(DETECT, autostart=false)
    assert parameters(stage)['autostart'] is False


def test_all_that_read_images_are_told_how_they_are(launched):
    overlay = launched(DETECT, image_transport='compressed', rectified='true')[-1]
    assert {name: parameters(overlay)[name] for name in ('image_transport', 'rectified')} == {
        'image_transport': 'compressed', 'rectified': True}


@pytest.mark.parametrize('name', ['autostart', 'use_sim_time', 'rectified', 'use_respawn', 'camera',
                                  'overlay'])
def test_another_word_for_a_flag_ends_the_launch(name: str, launched):
    with pytest.raises(ConfigError, match=f"launch argument {name}: expected true or false, got 'treu'"):
        launched(DETECT, **{name: 'treu'})


@pytest.mark.parametrize(('name', 'word', 'options'), [
    ('mode', 'foo', "'nodes', 'pipeline'"), ('image_reliability', 'best', "'auto', 'reliable', 'best_effort'"),
    ('image_transport', 'theora', "'raw', 'compressed'")])
def test_a_choice_that_there_is_not_ends_the_launch(name: str, word: str, options: str, launched):
    with pytest.raises(RuntimeError, match=f'"{name}" provided value "{word}" is not valid. .*{options}'):
        launched(DETECT, **{name: word})


@pytest.mark.parametrize('file', ['typo.yaml', 'typo', '/no/such/typo.yaml'])
def test_a_parameter_file_that_there_is_not_ends_the_launch(file: str, launched):
    with pytest.raises(ConfigError, match=f'launch argument params_file: {file}: expected a .*'):
        launched(DETECT, params_file=file)


def test_a_parameter_file_goes_to_all_nodes(tmp_path: Path, launched):
    file = tmp_path / 'mine.yaml'
    file.write_text('/**: {ros__parameters: {}}')
    assert {node['parameters'][0] for node in launched(DETECT, params_file=str(file))} == {str(file)}
    assert {Path(node['parameters'][0]).name for node in launched(DETECT, params_file='kitti')} == {'kitti.yaml'}


@pytest.mark.parametrize('path', [DETECT, REPLAY], ids=['detect', 'replay'])
def test_the_transport_environment_is_that_of_our_nodes_alone(path: Path, tmp_path: Path, launched):
    """Whoever includes the file starts other nodes after ours."""
    before = dict(os.environ)
    nodes = launched(path, **({'bag': str(tmp_path)} if path == REPLAY else {}))
    assert all(set(node['additional_env']) == {PROFILE_VARIABLE, *VARIABLES} for node in nodes)
    assert dict(os.environ) == before
    os.environ[PROFILE_VARIABLE] = 'mine.xml'
    for node in launched(path, **({'bag': str(tmp_path)} if path == REPLAY else {})):
        assert set(node['additional_env']) == set(VARIABLES)


@pytest.mark.parametrize('scheme', ['', 'file://'])
@pytest.mark.parametrize('mode', STAGES)
def test_a_file_waits_for_the_stages_and_the_launch_ends_with_it(mode: str, scheme: str, tmp_path: Path, launched):
    camera = {node['executable']: node for node in launched(
        DETECT, mode=mode, source=f'{scheme}{tmp_path}', use_respawn='true')}['camera']
    assert parameters(camera)['wait_for_nodes'] == ','.join(STAGES[mode])
    assert camera['respawn'] is False
    check_ends(camera['on_exit'])


@pytest.mark.parametrize('source', ['0', '2', 'rtsp://127.0.0.1:8554/drone'])
def test_a_live_camera_waits_for_nobody(source: str, launched):
    camera = {node['executable']: node for node in launched(DETECT, source=source, use_respawn='true')}['camera']
    assert parameters(camera)['source'] == source
    assert 'wait_for_nodes' not in parameters(camera)
    assert (camera['respawn'], 'on_exit' in camera) == (True, False)


def test_a_source_that_there_is_not_ends_the_launch(launched):
    with pytest.raises(SourceError, match="launch argument source: expected a file or folder, got 'flihgt.mp4'"):
        launched(DETECT, source='flihgt.mp4')


def check_ends(on_exit: Callable[..., Any]) -> None:
    """A launch ends well with a process that did, fails with one that failed, and ends but once."""
    def ended(code: int, is_shutdown: bool = False) -> Any:
        event = SimpleNamespace(process_name='player-1', returncode=code)
        return on_exit(event, SimpleNamespace(is_shutdown=is_shutdown))

    assert [type(action).__name__ for action in ended(0)] == ['Shutdown']
    assert ended(0, is_shutdown=True) == ended(1, is_shutdown=True) == []
    with pytest.raises(SourceError, match='player-1 failed with exit code 2'):
        ended(2)


@pytest.mark.parametrize('mode', STAGES)
def test_replay_starts_detector_and_player(mode: str, tmp_path: Path, launched):
    bag = tmp_path / '2024.mcap'
    bag.touch()
    nodes = launched(REPLAY, mode=mode, bag=str(bag), overlay='false', rate='2', loop='True', clock='no')
    assert names(nodes) == [*STAGES[mode], 'bag_player']
    assert parameters(nodes[-1]) == {
        'bag': str(bag), 'rate': 2.0, 'loop': True, 'topics': '', 'clock': False,
        'wait_for_nodes': ','.join(STAGES[mode])}
    assert all(parameters(node)['use_sim_time'] is True for node in nodes[:-1])
    check_ends(nodes[-1]['on_exit'])


@pytest.mark.parametrize(('arguments', 'words'), [
    ({}, 'Required launch argument "bag" was not provided'),
    ({'bag': ''}, "launch argument bag: expected a file or folder, got ''"),
    ({'bag': 'flihgt.mcap'}, "launch argument bag: expected a file or folder, got 'flihgt.mcap'"),
    ({'bag': '/', 'rate': 'fast'}, "launch argument rate: expected a number, got 'fast'"),
    ({'bag': '/', 'loop': 'maybe'}, "launch argument loop: expected true or false, got 'maybe'"),
])
def test_replay_of_nothing_ends_the_launch(arguments: dict[str, str], words: str, launched):
    with pytest.raises((RuntimeError, MotionDetectError), match=words):
        launched(REPLAY, **arguments)


def test_parameters_given_to_nodes_are_declared_by_them(tmp_path: Path, launched):
    nodes = [*launched(DETECT, source=str(tmp_path)), *launched(REPLAY, bag=str(tmp_path))]
    given = {name for node in nodes for name in parameters(node)}
    assert {'source', 'autostart', 'bag', 'wait_for_nodes'} <= given <= NODE_PARAMETERS


def test_several_cameras_have_a_namespace_each(launched):
    nodes = launched(CAMERAS, cameras='front=0 rear=rtsp://127.0.0.1/b=1', mode='pipeline', autostart='no')
    assert [(node['namespace'], node['executable']) for node in nodes] == [
        (name, node) for name in ('front', 'rear') for node in ('pipeline', 'camera', 'overlay')]
    assert [(parameters(node)['source'], parameters(node)['frame_id']) for node in nodes[1::3]] == [
        ('0', 'front_optical_frame'), ('rtsp://127.0.0.1/b=1', 'rear_optical_frame')]
    assert not any(parameters(node)['autostart'] for node in nodes)


@pytest.mark.parametrize('cameras', ['', 'front', 'front=', '=0', 'front=0 front=1', 'front = 0'])
def test_cameras_without_names_or_sources_end_the_launch(cameras: str, launched):
    with pytest.raises(ConfigError, match='launch argument cameras: expected "front=0 rear=1", each name once, got'):
        launched(CAMERAS, cameras=cameras)
