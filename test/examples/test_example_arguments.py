"""What users give to the examples: whole numbers are taken, nonsense is refused in one line."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
from collections.abc import Iterator
from importlib.util import find_spec
from pathlib import Path

import pytest
from flights import EXAMPLES
from peers import TIMEOUT_S, Peer, picture
from rcl_interfaces.srv import GetParameters
from sensor_msgs.msg import PointCloud2
from std_msgs.msg import Header

from motion_detect_ros.bridge.records import detections_to_msg
from motion_detect_ros.bridge.transport import environment
from motion_detect_ros.cli.demo import FLIGHT_BAG
from motion_detect_ros.cli.domains import own_domain
from motion_detect_ros.core.types import empty_detections
from motion_detect_ros.sources.bags import BagWriter

WHOLE = {
    'planner': ('horizon_s:=3', 'look_ahead_s:=2', 'corridor:=1'),
    'follow': ('gain:=2', 'lost_s:=1'),
    'bearings_to_points': ('range_m:=4',),
    'autopilot_frames': ('range_m:=4', 'camera_pitch_deg:=30'),
    'watchdog': ('detections_s:=2',),
}
#: Name of the node where it is not that of the example.
NAMES = {'planner': 'avoidance', 'follow': 'follower'}
REFUSED = {
    'planner': ('horizon_s:=-3.0', 'corridor:=0.0', 'horizon_s:=soon'),
    'follow': ('gain:=-1.0', 'lost_s:=-1'),
    'bearings_to_points': ('range_m:=-4.0', 'range_m:=0', 'range_m:=far'),
    'autopilot_frames': ('range_m:=-4.0', 'camera_pitch_deg:=300'),
    'watchdog': ('stages:=""', 'stages:=pipeline', 'stages:="/pipeline,"', 'detections_s:=0'),
}


def variables() -> dict[str, str]:
    return {**os.environ, **environment(), 'ROS_DOMAIN_ID': str(own_domain()),
            'ROS_AUTOMATIC_DISCOVERY_RANGE': 'LOCALHOST'}


@pytest.fixture
def peer(monkeypatch: pytest.MonkeyPatch) -> Iterator[Peer]:
    monkeypatch.setenv('ROS_AUTOMATIC_DISCOVERY_RANGE', 'LOCALHOST')
    one = Peer(own_domain())
    yield one
    one.close()


def end_of(name: str, *words: str | Path) -> tuple[int, str, list[str]]:
    """Exit code, stdout, and lines on stderr without those of Fast DDS about ports in use."""
    done = subprocess.run([sys.executable, EXAMPLES / f'{name}.py', *words], env=variables(), text=True,
                          capture_output=True, timeout=60, check=False)
    return done.returncode, done.stdout, [line for line in done.stderr.splitlines() if 'RTPS_TRANSPORT' not in line]


def test_whole_numbers_are_taken(peer: Peer) -> None:
    processes = {name: subprocess.Popen(
        [sys.executable, EXAMPLES / f'{name}.py', '--ros-args', *(word for each in given for word in ('-p', each))],
        env=variables()) for name, given in WHOLE.items()}
    try:
        for name, given in WHOLE.items():
            node, names = NAMES.get(name, name), [each.partition(':=')[0] for each in given]
            values = peer.call(GetParameters, f'/{node}/get_parameters', names=names).values
            assert [f'{one}:={value.double_value:g}' for one, value in zip(names, values, strict=True)] == [*given]
        peer.advertise(PointCloud2, 'detections')
        assert peer.matched('detections', len(WHOLE))
        for process in processes.values():
            process.send_signal(signal.SIGINT)
        assert {name: process.wait(TIMEOUT_S) for name, process in processes.items()} == dict.fromkeys(WHOLE, 0)
    finally:
        for process in processes.values():
            process.kill()


@pytest.mark.parametrize('name', ['follow', 'bearings_to_points', 'autopilot_frames'])
def test_without_a_calibration_the_missing_bearings_are_told(name: str, peer: Peer, tmp_path: Path) -> None:
    log = tmp_path / 'log'
    with log.open('wb') as stream:
        process = subprocess.Popen([sys.executable, EXAMPLES / f'{name}.py'], env=variables(), stderr=stream)
    try:
        detections = peer.advertise(PointCloud2, 'detections')
        assert peer.matched('detections', 1)

        def told() -> bool:
            detections.publish(detections_to_msg(empty_detections(1), Header()))
            peer.rest(0.1)
            return 'objects without bearings: camera_info is missing or all zero' in log.read_text()

        assert peer.until(told)
        process.send_signal(signal.SIGINT)
        assert process.wait(TIMEOUT_S) == 0
    finally:
        process.kill()


@pytest.mark.parametrize(('name', 'given'), [(name, each) for name, given in REFUSED.items() for each in given])
def test_wrong_values_are_refused(name: str, given: str) -> None:
    code, printed, errors = end_of(name, '--ros-args', '-p', given)
    assert (code, printed, len(errors)) == (2, '', 1), errors
    assert errors[0].startswith(f'parameter {given.partition(":=")[0]}: expected ')


@pytest.mark.parametrize('name', WHOLE)
def test_what_does_not_stand_behind_ros_args_is_refused(name: str) -> None:
    given = WHOLE[name][0]
    assert end_of(name, '-p', given) == (
        2, '', [f'{name}: expected --ros-args before all arguments, got -p {given}; --help shows how'])


def test_vision_boxes_without_vision_msgs() -> None:
    if find_spec('vision_msgs'):
        pytest.skip('vision_msgs is installed')
    assert end_of('vision_boxes') == (
        2, '', ['vision_boxes: expected the package vision_msgs: sudo apt install ros-jazzy-vision-msgs'])


class TestReadDetectionsMcap:
    def test_takes_one_bag(self) -> None:
        for words in ((), ('a.mcap', 'b.mcap')):
            assert end_of('read_detections_mcap', *words) == (
                2, '', [f'read_detections_mcap: expected one bag, got {len(words)} arguments'])

    @pytest.mark.parametrize(('name', 'words'), [
        ('missing.mcap', 'missing'), ('broken.mcap', 'magic'), ('notes.txt', "'.txt'"), ('folder', 'metadata')])
    def test_says_what_is_no_bag(self, name: str, words: str, tmp_path: Path) -> None:
        for each in ('broken.mcap', 'notes.txt'):
            (tmp_path / each).write_text('no bag at all, but long enough to hold a magic number')
        (tmp_path / 'folder').mkdir()
        code, printed, errors = end_of('read_detections_mcap', tmp_path / name)
        assert (code, printed, len(errors)) == (2, '', 1), errors
        assert errors[0].startswith(f'read_detections_mcap: {tmp_path / name}: ') and words in errors[0]

    def test_says_which_topics_a_bag_has_instead(self, tmp_path: Path) -> None:
        bag = tmp_path / FLIGHT_BAG
        with BagWriter(bag) as writer:
            writer.write_image(picture(0), 1_000_000_000)
        assert end_of('read_detections_mcap', bag) == (
            2, '', [f'read_detections_mcap: {bag}: expected a topic detections, got /image_raw'])
