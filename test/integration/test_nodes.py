"""The nodes as users run them: processes, signals, parameters, bad messages, the shipped transport profile."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
import time
from pathlib import Path

import cv2
import numpy as np
import pytest

from motion_detect_ros.bridge.transport import environment
from motion_detect_ros.cli.live import STAGES, LiveGraph, own_domain
from motion_detect_ros.sources.bags import BagWriter
from motion_detect_ros.sources.messages import IMAGE, header, make, serialize

NODES = ('camera', 'ego_motion', 'optical_flow', 'art2_clustering', 'pipeline', 'overlay', 'bag_player')
TIMEOUT_S = 60.0
PERIOD_NS = 100_000_000


def texture(seed: int, height: int, width: int) -> np.ndarray:
    noise = np.random.default_rng(seed).integers(0, 256, (height, width), np.uint8)
    return cv2.normalize(cv2.GaussianBlur(noise, (0, 0), 1.5), None, 0, 255, cv2.NORM_MINMAX)


GROUND, THING = texture(1, 300, 500), texture(2, 50, 60)


def scene(index: int) -> np.ndarray:
    """A drifting camera over textured ground; a block goes its own way."""
    picture = GROUND[20:260, 2 * index:320 + 2 * index].copy()
    left = 30 + 5 * index
    picture[90:140, left:left + 60] = THING
    return cv2.cvtColor(picture, cv2.COLOR_GRAY2BGR)


def write_scene(path: Path, frames: int, size: tuple[int, int] | None = None, period_ns: int = PERIOD_NS) -> None:
    with BagWriter(path, compress=False) as bag:
        for index in range(frames):
            image = scene(index % 40) if size is None else cv2.resize(scene(index % 40), size)
            bag.write_image(image, (index + 1) * period_ns)


def node_process(node: str, *arguments: str) -> subprocess.Popen[str]:
    variables = {**environment(), 'ROS_DOMAIN_ID': str(own_domain()), 'ROS_AUTOMATIC_DISCOVERY_RANGE': 'LOCALHOST'}
    command = [sys.executable, '-m', f'motion_detect_ros.nodes.{node}', '--ros-args', *arguments]
    return subprocess.Popen(command, env=variables, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True)


@pytest.fixture
def folder_of_images(tmp_path: Path) -> Path:
    for index in range(30):
        cv2.imwrite(str(tmp_path / f'{index:04d}.png'), scene(index))
    return tmp_path


@pytest.mark.parametrize('stop', [signal.SIGINT, signal.SIGTERM], ids=['SIGINT', 'SIGTERM'])
@pytest.mark.parametrize('node', NODES)
def test_clean_end_on_a_signal(node: str, stop: signal.Signals, tmp_path: Path, folder_of_images: Path):
    arguments = {'camera': ['-p', f'source:={folder_of_images}', '-p', 'fps:=1.0'], 'bag_player': []}.get(node, [])
    if node == 'bag_player':
        write_scene(tmp_path / 'scene.mcap', 10)
        arguments = ['-p', f'bag:={tmp_path / "scene.mcap"}', '-p', 'loop:=true']
    process = node_process(node, *arguments)
    try:
        time.sleep(4.0)
        assert process.poll() is None, process.stderr.read()
        process.send_signal(stop)
        _, errors = process.communicate(timeout=TIMEOUT_S)
    finally:
        process.kill()
    assert process.returncode == 0, errors
    assert 'Traceback' not in errors


@pytest.mark.parametrize(('node', 'arguments', 'words'), [
    ('pipeline', ['-p', 'art2.vigilance:=1.5'], ('art2.vigilance', '0.0', '1.0')),
    ('ego_motion', ['-p', 'ego_motion.max_corners:=many'], ('ego_motion.max_corners', 'int')),
    ('pipeline', ['-p', 'ego_motion.smoothing:=magic'], ('ego_motion.smoothing', 'kalman', 'magic')),
    ('bag_player', [], ('bag',)),
    ('bag_player', ['-p', 'bag:=/nowhere.mcap'], ('/nowhere.mcap',)),
    ('camera', ['-p', 'source:=/nowhere'], ('/nowhere',)),
])
def test_wrong_use_is_one_line_and_exit_code_2(node: str, arguments: list[str], words: tuple[str, ...]):
    process = node_process(node, *arguments)
    _, errors = process.communicate(timeout=TIMEOUT_S)
    assert process.returncode == 2
    assert len(errors.strip().splitlines()) == 1, errors
    for word in words:
        assert word in errors


def test_a_malformed_image_costs_that_image_only(tmp_path: Path):
    bag = tmp_path / 'scene.mcap'
    with BagWriter(bag, compress=False) as writer:
        for index in range(20):
            if index == 12:
                writer.write_raw('/image_raw', IMAGE, broken_image((index + 1) * PERIOD_NS), (index + 1) * PERIOD_NS)
            else:
                writer.write_image(scene(index), (index + 1) * PERIOD_NS)
    with LiveGraph('default', ('pipeline',)) as graph:
        playback = graph.play(bag, 19)
        assert 'expected' in graph.output('pipeline')
    assert [m.stamp_ns // PERIOD_NS for m in playback.received] == [n for n in range(1, 21) if n != 13]
    assert graph.exit_codes == {'pipeline': 0}


def broken_image(stamp: int) -> bytes:
    """A serialised image that promises 230400 bytes and holds 1000."""
    return serialize(make(
        IMAGE, header=header(stamp, 'camera'), height=240, width=320, encoding='bgr8', is_bigendian=0, step=960,
        data=np.zeros(1000, np.uint8)))


def test_300_large_images_between_processes_none_lost(tmp_path: Path):
    """20 Hz, 960x540, by the shipped profile; the listener is a stage that answers every image it hears."""
    bag = tmp_path / 'large.mcap'
    write_scene(bag, 300, (960, 540), 50_000_000)
    cheap = ('preprocessing.max_width_px:=240',)
    with LiveGraph('default', ('pipeline',), parameters=cheap) as graph:
        playback = graph.play(bag, 300)
    assert [m.stamp_ns for m in playback.received] == [(index + 1) * 50_000_000 for index in range(300)]


def test_stages_as_processes_find_the_moving_block(tmp_path: Path):
    bag = tmp_path / 'scene.mcap'
    write_scene(bag, 30)
    with LiveGraph('default', STAGES) as graph:
        playback = graph.play(bag, 30)
    assert len(playback.received) == 30
    late = [message.records for message in playback.received[12:]]
    assert all(len(records) == 1 for records in late)
    for index, records in enumerate(late, start=12):
        assert records['u'][0] == pytest.approx(30 + 5 * index + 29.5, abs=4.0)
        # 5 px a frame in the picture, and the camera drifts 2 px a frame the other way: 7 px in 0.1 s
        assert records['vel_u'][0] == pytest.approx(70.0, rel=0.1)
    assert {int(records['id'][0]) for records in late} == {int(late[0]['id'][0])}


def test_environment_keeps_what_the_user_set(monkeypatch: pytest.MonkeyPatch):
    monkeypatch.setenv('FASTRTPS_DEFAULT_PROFILES_FILE', '/mine.xml')
    assert environment()['FASTRTPS_DEFAULT_PROFILES_FILE'] == '/mine.xml'
    monkeypatch.delenv('FASTRTPS_DEFAULT_PROFILES_FILE')
    assert Path(environment()['FASTRTPS_DEFAULT_PROFILES_FILE']).name == 'fastdds_profile.xml'
    assert os.environ.get('FASTRTPS_DEFAULT_PROFILES_FILE') is None
