"""The launch files: by the real ``launch`` where it is installed (it has no wheels), by a small stand-in elsewhere."""

from __future__ import annotations

import ast
import importlib
import importlib.util
import os
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
from motion_detect_ros.launched_detector import ARGUMENTS
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


def names_of(path: Path) -> list[str]:
    """The arguments that a launch file declares."""
    own = [name for name, _, _ in constant(path, 'OWN')] if path != DETECT else []
    left_out = constant(path, 'FIXED' if path == REPLAY else 'REPLACED') if path != DETECT else {}
    return [*own, *(name for name, _, _ in ARGUMENTS if name not in left_out)]


def test_arguments_are_those_that_nav2_users_expect_and_all_are_explained():
    assert set(names_of(DETECT)) >= EXPECTED_BY_NAV2_USERS
    assert set(names_of(REPLAY)) >= EXPECTED_BY_NAV2_USERS - {'use_sim_time'}
    for name, default, text in (*ARGUMENTS, *constant(REPLAY, 'OWN'), *constant(CAMERAS, 'OWN')):
        assert isinstance(default, str | None) and text, name


@pytest.mark.parametrize(('path', 'without'), [
    (DETECT, set()), (REPLAY, {'camera', 'source', 'frame_id', 'use_sim_time'}), (CAMERAS, {'source', 'frame_id'})],
    ids=['detect', 'replay', 'cameras'])
def test_a_file_declares_what_has_an_effect(path: Path, without: set[str], launched):
    given = {'bag': '/', 'cameras': 'front=0'}
    launched(path, **given)
    assert {name for name, _, _ in ARGUMENTS} - set(launched.declared) == without
    assert sorted({*launched.declared, *given}) == sorted({*names_of(path), *given})


def test_nodes_are_programs_of_the_package(tmp_path: Path, launched):
    programs = set(constant(REPOSITORY / 'setup.py', 'NODES'))
    started = {name for mode in STAGES for nodes in (
        launched(DETECT, mode=mode), launched(REPLAY, bag=str(tmp_path), mode=mode)) for name in names(nodes)}
    assert started == programs


def test_remapped_topics_are_topics_of_the_nodes(launched):
    known = {value.name for value in vars(topics).values() if isinstance(value, topics.Topic)}
    for node in launched(DETECT, image_topic='cam/image', camera_info_topic='cam/info', imu_topic='fcu/imu'):
        assert dict(node['remappings']) == {
            'image_raw': 'cam/image', 'image_raw/compressed': 'cam/image/compressed', 'camera_info': 'cam/info',
            'imu': 'fcu/imu'}
        assert set(dict(node['remappings'])) <= known


@pytest.fixture
def launched(monkeypatch: pytest.MonkeyPatch) -> Iterator[Callable[..., list[dict[str, Any]]]]:
    """``launched(path, **arguments)``: options of the nodes that a launch file starts; ``launched.started`` has them
    also where it failed, ``launched.told`` what it says, ``launched.declared`` its arguments.

    By the real launch where it is installed, by a stand-in that evaluates arguments alike elsewhere.
    """
    if importlib.util.find_spec('launch_ros') is None:
        monkeypatch.syspath_prepend(str(STAND_IN))
    launch, general, actions = map(importlib.import_module, ('launch', 'launch.actions', 'launch_ros.actions'))
    monkeypatch.setattr(os, 'environ', {name: value for name, value in os.environ.items()
                                        if name not in {PROFILE_VARIABLE, *VARIABLES}})

    def run(path: Path, **arguments: str) -> list[dict[str, Any]]:
        found: list[dict[str, Any]] = []

        class Recorded(actions.Node):
            def __init__(self, **options: Any) -> None:
                super().__init__(**options)
                found.append(options)

        class Told(general.LogInfo):
            def __init__(self, *, msg: str) -> None:
                super().__init__(msg=msg)
                run.told.append(msg)

        monkeypatch.setattr(actions, 'Node', Recorded)
        monkeypatch.setattr(general, 'LogInfo', Told)
        context = launch.LaunchContext()
        context.launch_configurations.update(arguments)
        run.started, run.told = found, []

        def visit(entity: Any) -> None:
            if not isinstance(entity, actions.Node):
                for each in entity.visit(context) or ():
                    visit(each)

        visit(runpy.run_path(str(path))['generate_launch_description']())
        run.declared = list(context.launch_configurations)
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
    assert not camera.get('respawn')
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
    with pytest.raises(MotionDetectError, match='player-1 failed with exit code 2'):
        ended(2)


@pytest.mark.parametrize('mode', STAGES)
def test_replay_starts_detector_and_player(mode: str, tmp_path: Path, launched):
    bag = tmp_path / '2024.mcap'
    bag.touch()
    nodes = launched(REPLAY, mode=mode, bag=str(bag), overlay='false', rate='2', loop='True', clock='no')
    assert names(nodes) == [*STAGES[mode], 'bag_player']
    assert parameters(nodes[-1]) == {
        'bag': str(bag), 'rate': 2.0, 'loop': True, 'clock': False, 'use_sim_time': False, 'play_results': False,
        'wait_for_nodes': ','.join(STAGES[mode])}
    assert not nodes[-1]['remappings'], 'the topics of a bag keep their names'
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
    assert launched.started == [], 'these would run on, and nobody would end them'


def test_parameters_given_to_nodes_are_declared_by_them(tmp_path: Path, launched):
    nodes = [*launched(DETECT, source=str(tmp_path), autostart='1'), *launched(REPLAY, bag=str(tmp_path))]
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
    assert launched.started == []


@pytest.mark.parametrize(('name', 'word'), [('log_level', 'loud'), ('log_level', ''), ('cpus', '99999'), ('cpus', 'x')])
@pytest.mark.parametrize('path', [DETECT, REPLAY, CAMERAS], ids=['detect', 'replay', 'cameras'])
def test_what_would_end_every_node_ends_the_launch_before_it(path: Path, name: str, word: str, launched):
    with pytest.raises(ConfigError, match=f'launch argument {name}: expected .*, got {word!r}'):
        launched(path, bag='/', cameras='front=0', **{name: word})
    assert launched.started == []


def test_no_taskset_is_told(monkeypatch: pytest.MonkeyPatch, launched):
    os.environ['PATH'] = '/nowhere'
    with pytest.raises(ConfigError, match='launch argument cpus: expected the program taskset, got'):
        launched(DETECT, cpus='0')


@pytest.mark.parametrize(('given', 'passed'), [('WARN', 'WARN'), ('rcl:=debug', 'rcl:=debug')])
def test_cores_and_level_reach_all_nodes(given: str, passed: str, launched):
    nodes = launched(REPLAY, bag='/', log_level=given, cpus='0, 0')
    assert {tuple(node['arguments']) for node in nodes} == {('--ros-args', '--log-level', passed)}
    assert {node['prefix'] for node in nodes} == {'taskset --cpu-list 0,0'}


def test_player_takes_autostart_and_the_parameter_file(tmp_path: Path, launched):
    file = tmp_path / 'mine.yaml'
    file.write_text('/**: {ros__parameters: {position_s: 2.0, rate: 3.0}}')
    player = launched(REPLAY, bag='/', params_file=str(file), autostart='no')[-1]
    assert player['parameters'][0] == str(file)
    assert parameters(player)['autostart'] is False
    assert 'rate' not in parameters(player)


@pytest.mark.parametrize(('text', 'passed'), [
    ('/**: {ros__parameters: {rate: 2.0}}', {'play_results': False}),
    ('/**: {ros__parameters: {play_results: true}}', {}),
    ('/robot1/bag_player: {ros__parameters: {play_results: true}}', {}),
    ('/bag_player: {ros__parameters: {play_results: true}}', {'play_results': False}),
])
def test_replay_leaves_recorded_results_out_unless_the_file_says_otherwise(text: str, passed, tmp_path, launched):
    file = tmp_path / 'mine.yaml'
    file.write_text(text)
    given = parameters(launched(REPLAY, bag='/', params_file=str(file), namespace='robot1')[-1])
    assert {name: value for name, value in given.items() if name == 'play_results'} == passed


@pytest.mark.parametrize(('path', 'given', 'lines'), [
    (REPLAY, {'use_sim_time': 'false', 'source': '2'}, ["use_sim_time: 'false'", "source: '2'"]),
    (REPLAY, {'use_sim_time': 'True', 'camera': 'false', 'frame_id': ''}, []),
    (CAMERAS, {'frame_id': 'cam'}, ["frame_id: 'cam'"]),
], ids=['replay', 'replay as it is', 'cameras'])
def test_what_has_no_effect_is_told(path: Path, given: dict[str, str], lines: list[str], launched):
    nodes = launched(path, bag='/', cameras='front=0', mode='pipeline', **given)
    assert launched.told == [f'launch argument {line} has no effect here' for line in lines]
    assert parameters(nodes[0]).get('use_sim_time', False) is (path == REPLAY)


def test_what_was_not_given_is_left_to_the_parameter_file(launched):
    """A tuned preset keeps ``rectified`` and ``image_transport`` of its recording."""
    assert [parameters(node) for node in launched(DETECT)] == [{}] * 5
    assert [sorted(parameters(node)) for node in launched(REPLAY, bag='/', mode='pipeline')] == [
        ['use_sim_time'], ['use_sim_time'], ['bag', 'play_results', 'use_sim_time', 'wait_for_nodes']]


@pytest.mark.parametrize('section', ['/**', '/front/camera', '/**/camera', '/front/*', 'front/camera'])
def test_a_file_that_the_parameter_file_names_is_played_as_one(section: str, tmp_path: Path, launched):
    file = tmp_path / 'mine.yaml'
    other = '/rear/camera: {ros__parameters: {source: 1}}'
    file.write_text(f'{section}: {{ros__parameters: {{source: {tmp_path}}}}}\n{other}')
    camera = launched(DETECT, params_file=str(file), mode='pipeline', namespace='/front')[1]
    assert parameters(camera) == {'wait_for_nodes': 'pipeline'}
    check_ends(camera['on_exit'])
    camera = launched(DETECT, params_file=str(file), mode='pipeline', namespace='/front', source='0')[1]
    assert parameters(camera) == {'source': '0'}


@pytest.mark.parametrize(('text', 'words'), [
    ('/**: {ros__parameters: {source: /no/such.mp4}}', "source: expected a file or folder, got '/no/such.mp4'"),
    ('[1, 2]', 'mine.yaml: expected "/\\*\\*: ros__parameters:" at the top, got list'),
    ('{', 'mine.yaml: expected a YAML parameter file, got '),
])
def test_a_parameter_file_that_no_node_could_use_ends_the_launch(text: str, words: str, tmp_path: Path, launched):
    file = tmp_path / 'mine.yaml'
    file.write_text(text)
    with pytest.raises(MotionDetectError, match=f'launch argument params_file: .*{words}'):
        launched(DETECT, params_file=str(file))


@pytest.mark.parametrize('path', [DETECT, REPLAY, CAMERAS], ids=['detect', 'replay', 'cameras'])
def test_a_stage_or_camera_that_dies_fails_the_launch(path: Path, launched):
    nodes = launched(path, bag='/', cameras='front=0', source='0')
    event, context = SimpleNamespace(process_name='it-1', returncode=-9), SimpleNamespace(is_shutdown=False)
    for node in nodes:
        assert not node.get('respawn')
        if node['executable'] == 'overlay':  # pictures for people: the vehicle still has its detections
            assert 'on_exit' not in node
            continue
        with pytest.raises(MotionDetectError, match='it-1 failed with exit code -9'):
            node['on_exit'](event, context)
        if node['executable'] != 'bag_player':
            assert node['on_exit'](SimpleNamespace(process_name='it-1', returncode=0), context) == []


def test_what_is_started_again_does_not_fail_the_launch(launched):
    for node in launched(DETECT, use_respawn='true'):
        assert node['respawn'] is True and 'on_exit' not in node


def test_cameras_end_with_the_last_file(tmp_path: Path, launched):
    def ended(cameras: list[dict[str, Any]], *codes: int) -> list[Any]:
        context = SimpleNamespace(is_shutdown=False)
        return [camera['on_exit'](SimpleNamespace(process_name='camera', returncode=code), context)
                for camera, code in zip(cameras, codes, strict=True)]

    def cameras(sources: str) -> list[dict[str, Any]]:
        return [node for node in launched(CAMERAS, cameras=sources) if node['executable'] == 'camera']

    first, last = ended(cameras(f'front={tmp_path} rear={tmp_path}'), 0, 0)
    assert (first, [type(action).__name__ for action in last]) == ([], ['Shutdown'])
    assert ended(cameras(f'front={tmp_path} rear=0'), 0, 0) == [[], []]
    with pytest.raises(MotionDetectError, match='camera failed with exit code 2'):
        ended(cameras(f'front={tmp_path} rear={tmp_path}'), 2, 0)


@pytest.mark.parametrize('outer', ['robot1', '/robot1', 'robot1/'])
def test_cameras_are_below_the_namespace_that_was_given(outer: str, launched):
    nodes = launched(CAMERAS, cameras='front=0 /rear=1', namespace=outer, mode='pipeline')
    assert {node['namespace'] for node in nodes} == {f'{outer.rstrip("/")}/{name}' for name in ('front', 'rear')}


@pytest.mark.parametrize('cameras', ['front=0 b-c=1', 'front=0 2nd=1', 'front=0 rear=/no/such.mp4'])
def test_a_camera_that_cannot_be_keeps_all_from_starting(cameras: str, launched):
    words = 'launch argument (cameras: expected a namespace|source: expected a file)'
    with pytest.raises(MotionDetectError, match=words):
        launched(CAMERAS, cameras=cameras)
    assert launched.started == []
