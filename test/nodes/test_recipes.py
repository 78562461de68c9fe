"""docs/recipes.md and the files it names: what can be tried here, is."""

from __future__ import annotations

import re
import shutil
import subprocess
from pathlib import Path

import cv2
import pytest
import yaml
from peers import lossless, picture, small
from scipy.spatial.transform import Rotation
from sensor_msgs.msg import PointCloud2

from motion_detect_ros.bridge.records import read_detections
from motion_detect_ros.launched_detector import ARGUMENTS

REPOSITORY = Path(__file__).resolve().parents[2]
PAGE = (REPOSITORY / 'docs' / 'recipes.md').read_text(encoding='utf-8')
UNIT, DOCKERFILE = REPOSITORY / 'examples' / 'motion_detect.service', REPOSITORY / 'examples' / 'Dockerfile'


def whole(namespace: str) -> list[str]:
    """Settings under which no image and no answer is lost."""
    return lossless(f'{namespace}/image_raw', f'{namespace}/detections')


def test_two_cameras_in_namespaces_do_not_hear_each_other(peer, start, tmp_path):
    """The block goes right before the front camera, left before the rear one, whose pictures are mirrored."""
    answers = {}
    for name in ('front', 'rear'):
        folder = tmp_path / name
        folder.mkdir()
        for index in range(30):
            cv2.imwrite(str(folder / f'{index:03d}.png'), picture(index)[:, ::1 if name == 'front' else -1])
        answers[name] = peer.subscribe(PointCloud2, f'/{name}/detections')
        start('pipeline', *small('queue_size:=100'), *whole(name), '-r', f'__ns:=/{name}')
    for name in answers:
        peer.known_to(f'/{name}/pipeline')
        start('camera', *whole(name), '-r', f'__ns:=/{name}', '-p', f'source:={tmp_path / name}', '-p', 'fps:=10.0',
              '-p', 'wait_for_subscribers:=1', '-p', 'realtime:=false', '-p', f'frame_id:={name}')
    velocities = {name: [] for name in answers}

    def both_found() -> bool:
        for name, messages in answers.items():
            velocities[name] = [float(one['vel_u']) for message in messages for one in read_detections(message)]
        return all(len(found) > 5 for found in velocities.values())

    assert peer.until(both_found)
    assert all(velocity > 0 for velocity in velocities['front'])
    assert all(velocity < 0 for velocity in velocities['rear'])
    assert [{message.header.frame_id for message in answers[name]} for name in answers] == [{'front'}, {'rear'}]


def commands() -> str:
    """Every indented line of the page, lines that go on joined, and the unit's."""
    lines = re.sub(r'\\\n\s+', '', '\n'.join(re.findall(r'^    (.*(?:\\\n.*)*)', PAGE, re.MULTILINE)))
    return lines + '\n' + UNIT.read_text(encoding='utf-8')


def test_launch_arguments_exist():
    known = {argument for argument, *_ in ARGUMENTS}
    given = {word for line in re.findall(r'motion_detect\.launch\.py(.*)', commands())
             for word in re.findall(r'(\w+):=', line)}
    assert {'source', 'namespace', 'mode', 'use_respawn'} <= given
    assert given - known == set()


def test_example_parameters_and_topics_exist():
    lines = re.findall(r'python3 (\w+)\.py --ros-args (.*)', commands())
    assert {name for name, _ in lines} == {'autopilot_frames', 'bearings_to_points'}
    for name, words in lines:
        source = (REPOSITORY / 'examples' / f'{name}.py').read_text(encoding='utf-8')
        for given in re.findall(r'-[pr] ([\w/]+):=', words):
            assert f"'{given}'" in source, f'{name}: {given}'


def test_optical_frame_of_the_transform():
    """Its z is the robot's x (ahead), its x the robot's right, its y down; roll, pitch, yaw about fixed axes."""
    roll, pitch, yaw = (float(re.search(rf'--{name} (\S+)', PAGE)[1]) for name in ('roll', 'pitch', 'yaw'))
    turned = Rotation.from_euler('xyz', [roll, pitch, yaw]).apply([(0, 0, 1), (1, 0, 0), (0, 1, 0)])
    assert turned.round(3).tolist() == [[1, 0, 0], [0, -1, 0], [0, 0, -1]]


def test_nav2_circle_is_larger_than_the_assumed_range():
    (text,) = re.findall(r'```yaml\n(.*?)```', PAGE, re.DOTALL)
    monitor = yaml.safe_load(text)['collision_monitor']['ros__parameters']
    assert all(name in monitor for name in (*monitor['polygons'], *monitor['observation_sources']))
    assert monitor['near']['radius'] > float(re.search(r'bearings_to_points\.py --ros-args -p range_m:=(\S+)', PAGE)[1])
    assert "'points'" in (REPOSITORY / 'examples' / 'bearings_to_points.py').read_text(encoding='utf-8')
    assert monitor['movers']['topic'] == 'points'


def test_systemd_accepts_the_unit():
    analyze = shutil.which('systemd-analyze')
    if analyze is None:
        pytest.skip('systemd-analyze is not installed')
    done = subprocess.run([analyze, 'verify', UNIT], capture_output=True, text=True, timeout=60, check=False)
    complaints = [line for line in done.stderr.splitlines() if UNIT.name in line]
    assert (done.returncode, complaints) == (0, []), done.stderr


def test_container_installs_what_the_readme_says():
    readme = (REPOSITORY / 'README.md').read_text(encoding='utf-8')
    (wanted,) = re.findall(r'^ +(pip install --break-system-packages [\w ]+?)(?:  |$)', readme, re.MULTILINE)
    text = DOCKERFILE.read_text(encoding='utf-8')
    assert f'RUN {wanted}\n' in text
    assert 'ros:jazzy' in text
    assert text.index(wanted) < text.index('colcon build') < text.index('ENTRYPOINT')  # it compiles kernels with numba
    # The profile's segment for each of five nodes, the camera's and the overlay's among them.
    profile = (REPOSITORY / 'config' / 'fastdds_profile.xml').read_text(encoding='utf-8')
    segment = int(re.search(r'<segment_size>(\d+)', profile)[1])
    room = int(re.search(r'--shm-size=(\d+)m', text)[1]) * 2 ** 20
    assert room > 2 * 5 * segment
    assert f'--shm-size={room // 2 ** 20}m' in PAGE
