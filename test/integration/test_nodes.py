"""The nodes as users run them: processes, signals, parameters, bad messages, the shipped transport profile."""

from __future__ import annotations

import contextlib
import os
import signal
import subprocess
import sys
import threading
import time
from collections.abc import Iterator
from pathlib import Path

import cv2
import numpy as np
import pytest
from diagnostic_msgs.msg import DiagnosticArray
from peers import PATIENT, TIMEOUT_S, Peer, own_lines, ready
from sensor_msgs.msg import Image, PointCloud2

from motion_detect_ros.bridge import topics
from motion_detect_ros.bridge.images import header_of, image_to_msg, stamp_ns
from motion_detect_ros.bridge.transport import environment
from motion_detect_ros.cli.demo import QUEUE_SIZE
from motion_detect_ros.cli.domains import lock_of, own_domain
from motion_detect_ros.cli.live import STAGES, LiveGraph, queues
from motion_detect_ros.sources.bags import BagWriter
from motion_detect_ros.sources.messages import IMAGE, header, make, serialize

NODES = ('camera', 'ego_motion', 'optical_flow', 'art2_clustering', 'pipeline', 'overlay', 'bag_player')
PERIOD_NS = 100_000_000
#: What every image brings along.
TOPICS = (topics.IMAGE, topics.CAMERA_INFO, topics.EGO_MOTION, topics.FLOW, topics.DETECTIONS, topics.CLOCK)


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
    return subprocess.Popen(command, env=variables, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True,
                            pass_fds=lock_of(own_domain()))


@contextlib.contextmanager
def process_of(node: str, *arguments: str) -> Iterator[subprocess.Popen[str]]:
    """A node that must end cleanly."""
    process = node_process(node, *arguments)
    try:
        yield process
        process.send_signal(signal.SIGINT)
        _, errors = process.communicate(timeout=TIMEOUT_S)
    finally:
        process.kill()
    assert process.returncode == 0, errors


@contextlib.contextmanager
def peer_here() -> Iterator[Peer]:
    """With the transport profile that the package ships."""
    with pytest.MonkeyPatch.context() as patch:
        for name, value in {**environment(), 'ROS_AUTOMATIC_DISCOVERY_RANGE': 'LOCALHOST'}.items():
            patch.setenv(name, value)
        peer = Peer(own_domain())
        try:
            yield peer
        finally:
            peer.close()


@pytest.fixture(scope='module')
def inputs(tmp_path_factory: pytest.TempPathFactory) -> dict[str, list[str]]:
    """What the nodes at the beginning of the graph read, as parameters."""
    folder = tmp_path_factory.mktemp('inputs')
    write_scene(folder / 'scene.mcap', 10)
    images = folder / 'images'
    images.mkdir()
    for index in range(3):
        cv2.imwrite(str(images / f'{index:04d}.png'), scene(index))
    return {'camera': ['-p', f'source:={images}', '-p', 'fps:=0.01'],  # for minutes
            'bag_player': ['-p', f'bag:={folder / "scene.mcap"}', '-p', 'loop:=true']}


@pytest.fixture(scope='module', params=[signal.SIGINT, signal.SIGTERM], ids=['SIGINT', 'SIGTERM'])
def working(request: pytest.FixtureRequest, inputs: dict[str, list[str]]):
    """The signal, and every node as a process that works, each in a namespace of its own."""
    with peer_here() as peer:
        reports = peer.subscribe(DiagnosticArray, '/diagnostics')
        running = {node: node_process(node, *inputs.get(node, []), '-r', f'__ns:=/{node}s') for node in NODES}

        def active() -> set[str]:
            return {status.name for report in reports for status in report.status if status.message != 'inactive'}

        try:
            assert peer.until(lambda: {f'/{node}s/{node}' for node in NODES} <= active()), active()
            yield request.param, running
        finally:
            for process in running.values():
                process.kill()


@pytest.mark.parametrize('node', NODES)
def test_clean_end_on_a_signal(node: str, working: tuple[signal.Signals, dict[str, subprocess.Popen[str]]]):
    stop, running = working
    assert running[node].poll() is None, running[node].stderr.read()
    running[node].send_signal(stop)
    _, errors = running[node].communicate(timeout=TIMEOUT_S)
    assert running[node].returncode == 0, errors
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
    assert len(own_lines(errors)) == 1, errors
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
    with LiveGraph('default', ('pipeline',), parameters=PATIENT) as graph:
        playback = graph.play(bag, 19)
        assert 'expected' in graph.output('pipeline')
    assert [m.stamp_ns // PERIOD_NS for m in playback.received] == [n for n in range(1, 21) if n != 13]
    assert graph.exit_codes == {'pipeline': 0}


def broken_image(stamp: int) -> bytes:
    """A serialised image that promises 230400 bytes and holds 1000."""
    return serialize(make(
        IMAGE, header=header(stamp, 'camera'), height=240, width=320, encoding='bgr8', is_bigendian=0, step=960,
        data=np.zeros(1000, np.uint8)))


@pytest.mark.parametrize('topic', TOPICS, ids=lambda topic: topic.name)
def test_the_demo_lets_nothing_wait_less_than_usual(topic: topics.Topic):
    settings = dict(setting.split(':=') for setting in queues(QUEUE_SIZE))
    for end in ('publisher', 'subscription'):
        wanted = max(topic.qos().depth, QUEUE_SIZE)
        assert int(settings[f'qos_overrides./{topic.name.lstrip("/")}.{end}.depth']) >= wanted


class _SlowToBeFound(LiveGraph):
    """The first stage stands still from when it has announced itself until a while after the others have."""

    freed = False

    def _spawn(self, node: str, parameters: list[str]) -> subprocess.Popen[bytes]:
        process = super()._spawn(node, parameters)
        if node == STAGES[0]:
            while self.planner.subscribers_of('image_raw') < 1:
                time.sleep(0.01)
            process.send_signal(signal.SIGSTOP)
            threading.Thread(target=self._free, args=(process,), daemon=True).start()
        return process

    def _free(self, process: subprocess.Popen[bytes]) -> None:
        deadline = time.monotonic() + TIMEOUT_S
        while self.planner.subscribers_of('image_raw') < len(STAGES) and time.monotonic() < deadline:
            time.sleep(0.01)
        time.sleep(2.0)
        self.freed = True
        process.send_signal(signal.SIGCONT)


def test_the_graph_is_up_once_the_stages_have_found_each_other():
    """A planner that sees all of them shows nothing: what a stage publishes before it has found the next is lost."""
    with _SlowToBeFound('default', STAGES) as graph:
        assert graph.freed


@pytest.mark.parametrize('stage', STAGES)
def test_the_demo_waits_for_a_stage_that_gets_no_processor(tmp_path: Path, stage: str):
    """Held for about ten images, as on a busy machine: all are answered in the end."""
    bag = tmp_path / 'scene.mcap'
    write_scene(bag, 20)
    with LiveGraph('default', STAGES, parameters=queues(QUEUE_SIZE)) as graph:
        holding = threading.Thread(target=hold, args=(graph, stage), daemon=True)
        holding.start()
        playback = graph.play(bag, 20)
        holding.join(TIMEOUT_S)
    assert [m.stamp_ns // PERIOD_NS for m in playback.received] == list(range(1, 21))


def hold(graph: LiveGraph, stage: str, until: int = 14) -> None:
    """From the fourth image on, until so many have been published."""
    process_id = graph.process_id(stage)
    while graph.planner.published < 4:
        time.sleep(0.01)
    os.kill(process_id, signal.SIGSTOP)
    try:
        while graph.planner.published < until:
            time.sleep(0.01)
    finally:
        os.kill(process_id, signal.SIGCONT)


def test_a_player_that_waits_in_vain_goes_on(tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    """A stage that stands still until all 30 images are published: the player is paused, and let go without an answer;
    then all are answered.
    """
    monkeypatch.setattr('motion_detect_ros.cli.holding.STALL_S', 2.0)
    bag = tmp_path / 'scene.mcap'
    write_scene(bag, 30)
    with LiveGraph('default', STAGES, parameters=PATIENT) as graph:
        holding = threading.Thread(target=hold, args=(graph, 'optical_flow', 30), daemon=True)
        holding.start()
        playback = graph.play(bag, 30, hold=True)
        holding.join(TIMEOUT_S)
    assert playback.held_s > 1.9
    assert [m.stamp_ns // PERIOD_NS for m in playback.received] == list(range(1, 31))


LARGE = (960, 540)
CHEAP = ('preprocessing.max_width_px:=240',)


def test_large_images_between_processes_all_arrive():
    """By the shipped profile; the subscriber is a stage that answers every image, and gets the next one then."""
    arguments = ['-p', CHEAP[0]]
    with process_of('pipeline', *arguments), peer_here() as peer:
        answers, publisher = peer.subscribe(PointCloud2, 'detections'), peer.advertise(Image, 'image_raw')
        assert ready(peer, 'image_raw')
        for index in range(100):
            image = cv2.resize(scene(index % 40), LARGE)
            publisher.publish(image_to_msg(image, header_of((index + 1) * PERIOD_NS, 'front')))
            assert peer.until(lambda index=index: len(answers) > index), f'no answer to image {index}'
    assert [stamp_ns(answer.header) for answer in answers] == [(index + 1) * PERIOD_NS for index in range(100)]


@pytest.mark.timing
def test_300_large_images_at_20_hz_none_lost(tmp_path: Path):
    bag = tmp_path / 'large.mcap'
    write_scene(bag, 300, LARGE, 50_000_000)
    with LiveGraph('default', ('pipeline',), parameters=CHEAP) as graph:
        playback = graph.play(bag, 300)
    assert [m.stamp_ns for m in playback.received] == [(index + 1) * 50_000_000 for index in range(300)]


def test_stages_as_processes_find_the_moving_block(tmp_path: Path):
    bag = tmp_path / 'scene.mcap'
    write_scene(bag, 30)
    with LiveGraph('default', STAGES, parameters=PATIENT) as graph:
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
