"""``replay --live``: the bag's own topic names, the answers of the replay in process, frames numbered by the bag."""

from __future__ import annotations

import csv
import fcntl
import json
import os
import signal
import subprocess
import sys
import time
from collections.abc import Callable
from pathlib import Path

import cv2
import numpy as np
import pytest
import yaml
from bag_contents import contents
from peers import PATIENT, TIMEOUT_S, own_lines
from test_nodes import PERIOD_NS, broken_image, peer_here, scene, write_scene

from motion_detect_ros.__main__ import main
from motion_detect_ros.bridge import topics
from motion_detect_ros.cli.domains import own_domain
from motion_detect_ros.cli.live import STAGES
from motion_detect_ros.core.types import DETECTION_DTYPE, NANOSECONDS, CameraModel
from motion_detect_ros.sources.bags import BagReader, BagWriter
from motion_detect_ros.sources.messages import COMPRESSED_IMAGE, IMAGE, header, image, make, serialize

FRAMES = 25
BROKEN = 15
CAMERA = CameraModel(320, 240, 300.0, 300.0, 160.0, 120.0, (-0.2, 0.05, 0.0, 0.0, 0.0))


def rows(folder: Path) -> list[dict[str, str]]:
    with (folder / 'detections.csv').open(newline='') as file:
        return list(csv.DictReader(file))


def records(folder: Path) -> np.ndarray:
    """Those of detections.mcap, which hold the bearings too."""
    messages = contents(folder / 'detections.mcap')['/detections']
    return np.concatenate([np.frombuffer(message.data, DETECTION_DTYPE) for _, message in messages])


def png(index: int, stamp_ns: int) -> bytes:
    _, data = cv2.imencode('.png', scene(index))
    return serialize(make(COMPRESSED_IMAGE, header=header(stamp_ns, 'camera'), format='png', data=data.ravel()))


def config(folder: Path, **further: int) -> list[str]:
    """Settings under which every image is answered, however late, and further ones of ``load``."""
    settings = {key: int(value) for key, value in (setting.split(':=') for setting in PATIENT)}
    settings.update({f'load.{name}': value for name, value in further.items()})
    path = folder / 'patient'  # any name will do, as offline
    path.write_text(yaml.safe_dump({'/**': {'ros__parameters': settings}}))
    return ['--config', str(path)]


@pytest.fixture
def patient(tmp_path: Path) -> list[str]:
    """Settings under which every image is answered, however late."""
    return config(tmp_path)


@pytest.fixture
def two_cameras(tmp_path: Path) -> Path:
    """Two cameras under names the nodes do not listen to; the second has one broken image."""
    path = tmp_path / 'two.mcap'
    with BagWriter(path) as bag:
        for index in range(FRAMES):
            stamp_ns = (index + 1) * PERIOD_NS
            bag.write_image(np.zeros((64, 96), np.uint8), stamp_ns, '/front/image_raw')
            if index == BROKEN:
                bag.write_raw('/rear/image_raw', IMAGE, broken_image(stamp_ns), stamp_ns)
            else:
                bag.write_image(scene(index), stamp_ns, '/rear/image_raw')
    return path


def test_one_of_two_cameras_with_a_broken_image(
    two_cameras: Path, patient: list[str], tmp_path: Path, capsys: pytest.CaptureFixture[str],
    monkeypatch: pytest.MonkeyPatch,
):
    """It is told and counted as offline, and neither waited for nor asked for again."""
    monkeypatch.setattr('motion_detect_ros.cli.live.IDLE_TIMEOUT_S', TIMEOUT_S)  # too long for the test to wait out
    words = ['replay', str(two_cameras), '--topic', '/rear/image_raw', *patient, '-o']
    assert main([*words, str(tmp_path / 'live'), '--live']) == 3
    line = capsys.readouterr().out
    assert f'{FRAMES} images, {FRAMES - 1} answers, latency ' in line
    assert line.endswith(' p95, 1 bad frames left out\n')
    assert main([*words, str(tmp_path / 'live'), '--live']) == 3
    assert capsys.readouterr().out == line.replace('\n', ' (finished earlier)\n')
    assert main([*words, str(tmp_path / 'offline')]) == 3
    live, offline = rows(tmp_path / 'live'), rows(tmp_path / 'offline')
    assert live
    assert live == offline
    assert {int(row['frame']) for row in live} >= set(range(BROKEN + 1, FRAMES))
    assert all(int(row['stamp_ns']) == (int(row['frame']) + 1) * PERIOD_NS for row in live)
    assert bad_frames(tmp_path / 'live') == bad_frames(tmp_path / 'offline') == 1
    summary = json.loads((tmp_path / 'live' / 'summary.json').read_text())
    assert (summary['wanted'], summary['answered'], summary['left_out']) == (FRAMES - 1, FRAMES - 1, {})


def bad_frames(folder: Path) -> int:
    return json.loads((folder / 'summary.json').read_text())['bad_frames']


def test_compressed_images_that_are_none_are_bad_as_offline(tmp_path: Path, capsys: pytest.CaptureFixture[str]):
    """A PNG that is cut off, bytes that are no picture, a picture too small to work on, and a message without stamp."""
    whole, tiny = (cv2.imencode('.png', picture)[1].tobytes() for picture in (scene(3), scene(11)[:3, :3]))
    bad = {3: whole[:2000], 7: b'no picture at all', 11: tiny}
    with BagWriter(tmp_path / 'a.mcap') as bag:
        for index in range(FRAMES):
            stamp_ns = (index + 1) * PERIOD_NS
            data = png(index, stamp_ns) if index not in bad else serialize(make(
                COMPRESSED_IMAGE, header=header(stamp_ns, 'camera'), format='png',
                data=np.frombuffer(bad[index], np.uint8)))
            bag.write_raw('/image_raw/compressed', COMPRESSED_IMAGE, data if index != 15 else data[:8], stamp_ns)
    words = ['replay', str(tmp_path / 'a.mcap'), '--no-report', '-o']
    assert main([*words, str(tmp_path / 'live'), '--live']) == 3
    assert ', 4 bad frames left out' in capsys.readouterr().out
    assert main([*words, str(tmp_path / 'offline')]) == 3
    assert bad_frames(tmp_path / 'live') == bad_frames(tmp_path / 'offline') == 4
    assert json.loads((tmp_path / 'live' / 'summary.json').read_text())['answered'] == FRAMES - 4
    assert rows(tmp_path / 'live') == rows(tmp_path / 'offline')


def test_a_pause_is_waited_out_where_images_are_left_out(tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    """By its middle as many images were published as are to be answered in all; it is longer than the player gets to
    end after that.
    """
    idle_s, pause_s = 5.0, 20
    monkeypatch.setattr('motion_detect_ros.cli.live.IDLE_TIMEOUT_S', idle_s)
    with BagWriter(tmp_path / 'a.mcap') as bag:
        for index in range(9):
            bag.write_image(scene(index), (index + 1) * PERIOD_NS + (index > 4) * pause_s * NANOSECONDS)
    given = config(tmp_path, decimation_keep=1, decimation_of=3)
    assert main(['replay', str(tmp_path / 'a.mcap'), *given, '--live', '-o', str(tmp_path / 'live')]) == 0
    summary = json.loads((tmp_path / 'live' / 'summary.json').read_text())
    assert (summary['frames'], summary['wanted'], summary['answered']) == (9, 3, 3)


@pytest.mark.parametrize(('of', 'answers'), [(1, 9), (3, 3)])
def test_images_whose_stamps_are_not_in_order_are_not_waited_for(
    of: int, answers: int, tmp_path: Path, monkeypatch: pytest.MonkeyPatch,
):
    """Every fourth image has the stamp of the one before; nodes and the replay in process leave it out."""
    monkeypatch.setattr('motion_detect_ros.cli.live.IDLE_TIMEOUT_S', 6.0)
    with BagWriter(tmp_path / 'a.mcap') as bag:
        for index in range(12):
            stamp_ns = (index + (index % 4 < 3)) * PERIOD_NS
            bag.write('/image_raw', image(scene(index), stamp_ns, 'camera'), (index + 1) * PERIOD_NS)
    words = ['replay', str(tmp_path / 'a.mcap'), *config(tmp_path, decimation_of=of), '--no-report', '-o']
    for run, option in (('live', ['--live']), ('offline', [])):
        assert main([*words, str(tmp_path / run), *option]) == 0
    live, offline = (json.loads((tmp_path / run / 'summary.json').read_text()) for run in ('live', 'offline'))
    assert (live['frames'], live['wanted'], live['answered']) == (12, answers, answers)
    assert (offline['frames'], offline['misstamped_frames']) == (answers, 3)


def test_compressed_rectified_images(patient: list[str], tmp_path: Path):
    projection = np.array([[250.0, 0.0, 150.0, 0.0], [0.0, 200.0, 110.0, 0.0], [0.0, 0.0, 1.0, 0.0]])
    with BagWriter(tmp_path / 'flight: #2.mcap') as bag:  # ROS reads parameters as YAML
        for index in range(FRAMES):
            stamp_ns = (index + 1) * PERIOD_NS
            bag.write_camera_info(CAMERA, stamp_ns, projection=projection)
            bag.write_raw('/image_raw/compressed', COMPRESSED_IMAGE, png(index, stamp_ns), stamp_ns)
    words = ['replay', str(tmp_path / 'flight: #2.mcap'), *patient, '--rectified', '-o']
    (tmp_path / 'live').mkdir()
    (tmp_path / 'live' / 'report.html').write_text('of an earlier replay')
    assert main([*words, str(tmp_path / 'live'), '--live']) == 0
    assert not (tmp_path / 'live' / 'report.html').exists()
    assert main([*words, str(tmp_path / 'offline')]) == 0
    assert rows(tmp_path / 'live')
    for name in ('live', 'offline'):
        seen = records(tmp_path / name)
        x, y = seen['u'] - 0.5, seen['v'] - 0.5  # matrices count from the centre of the first pixel
        ray = np.stack([(x - 150.0) / 250.0, (y - 110.0) / 200.0, np.ones(len(seen))])
        bearing = [seen[f'bearing_{axis}'] for axis in 'xyz']
        np.testing.assert_allclose(bearing, ray / np.linalg.norm(ray, axis=0), atol=1e-5)
        clouds = contents(tmp_path / name / 'detections.mcap')['/detections']
        assert {cloud.header.frame_id for _, cloud in clouds} == {'camera'}, 'that of the images'
    assert rows(tmp_path / 'live') == rows(tmp_path / 'offline')
    summary = json.loads((tmp_path / 'live' / 'summary.json').read_text())
    assert (summary['frames'], summary['answered'], summary['live']) == (FRAMES, FRAMES, True)
    assert 0.0 < summary['latency_ms']['p50'] <= summary['latency_ms']['p95']


def test_topic_that_is_not_there_is_one_line(two_cameras: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]):
    assert main(['replay', str(two_cameras), '--topic', '/left', '--live', '-o', str(tmp_path / 'o')]) == 2
    lines = capsys.readouterr().err.strip().splitlines()
    assert len(lines) == 1
    assert f'/front/image_raw (sensor_msgs/msg/Image, {FRAMES})' in lines[0]
    assert f'/rear/image_raw (sensor_msgs/msg/Image, {FRAMES})' in lines[0]


def truth_of(folder: Path, name: str, frames: int) -> Path:
    """Truth of a recording, in a folder of truths."""
    folder.mkdir()
    lines = ['frame,id,x,y,w,h,moving', *(f'{frame},1,10,10,20,20,1' for frame in range(frames))]
    (folder / f'{name}.csv').write_text('\n'.join(lines) + '\n')
    return folder


def test_a_live_replay_is_as_one_in_process_to_whom_comes_after(
    patient: list[str], tmp_path: Path, capsys: pytest.CaptureFixture[str],
):
    """A bad input costs itself, what is finished is left, the truth goes by the input's name, errors are drawn."""
    (tmp_path / 'bad.mp4').write_bytes(b'no video')
    with BagWriter(tmp_path / 'a.mcap') as bag:
        for index in range(FRAMES):
            bag.write_image(scene(index), (index + 1) * PERIOD_NS)
    inputs, out = [str(tmp_path / name) for name in ('bad.mp4', 'a.mcap')], tmp_path / 'out'
    words = ['replay', *inputs, '--live', *patient, '-o', str(out)]
    assert main(words) == 3
    captured = capsys.readouterr()
    refusal = f'{inputs[0]}: --live expects a bag; make one with the convert command'
    assert captured.err == f'error: {refusal}\n'
    first, *rest = captured.out.splitlines()
    assert first.startswith(f'{out}/a: {FRAMES} images, {FRAMES} answers, latency ')
    assert rest == ['2 inputs: 1 done, 1 failed', f'failed: {refusal}']
    states = [entry['state'] for entry in json.loads((out / 'replay.json').read_text())['inputs']]
    assert states == ['failed', 'done']
    before = {path.name: path.read_bytes() for path in (out / 'a').iterdir()}
    assert sorted(before) == ['detections.csv', 'detections.mcap', 'summary.json']

    assert main(words) == 3
    assert capsys.readouterr().out.splitlines()[0] == f'{first} (finished earlier)'
    assert {path.name: path.read_bytes() for path in (out / 'a').iterdir()} == before
    assert main([*words, '--config', 'visdrone']) == 2
    message = capsys.readouterr().err
    assert message.startswith(f'error: {out}/a: holds a result of something else (')
    assert message.count('\n') == 1
    assert main(['replay', inputs[1], '-o', str(out / 'a'), *patient]) == 2
    assert capsys.readouterr().err == (
        f'error: {out}/a: holds a result of something else (of replay --live); --force overwrites it\n')

    (out / 'a').rename(tmp_path / 'live')
    truth = truth_of(tmp_path / 'truth', 'a', FRAMES)
    assert main(['evaluate', str(tmp_path / 'live'), '--truth', str(truth), '--worst', '1', '-o',
                 str(tmp_path / 'worst')]) == 0
    assert len([*(tmp_path / 'worst').glob('*.png')]) == 1
    capsys.readouterr()
    assert main(['report', str(tmp_path / 'live')]) == 2
    assert capsys.readouterr().err == (
        f'error: {tmp_path}/live/summary.json: expected the summary of a replay in process, got that of replay --live, '
        'which has neither ego-motion nor times\n')

    csv_only = ['replay', inputs[1], '-o', str(tmp_path / 'live'), '--force', '--no-report', '--formats', 'csv']
    assert main(csv_only) == 0
    assert not (tmp_path / 'live' / 'detections.mcap').exists(), 'of another replay'


def test_a_damaged_bag_is_partial_and_finished_as_offline(
    patient: list[str], tmp_path: Path, capsys: pytest.CaptureFixture[str],
):
    """One is cut off, the other has lost a chunk in its midst, whose image nobody can answer."""
    for name in ('cut', 'hole'):
        with BagWriter(tmp_path / f'{name}.mcap', compress=False, chunk_bytes=100_000) as bag:  # a chunk an image
            for index in range(FRAMES):
                bag.write_image(scene(index), (index + 1) * PERIOD_NS)
    content = (tmp_path / 'cut.mcap').read_bytes()
    (tmp_path / 'cut.mcap').write_bytes(content[:int(0.8 * len(content))])
    at = content.index(scene(BROKEN).tobytes())
    (tmp_path / 'hole.mcap').write_bytes(content[:at] + bytes(1000) + content[at + 1000:])
    inputs, out = [str(tmp_path / f'{name}.mcap') for name in ('cut', 'hole')], tmp_path / 'live'
    assert main(['replay', *inputs, *patient, '--no-report', '-o', str(tmp_path / 'offline')]) == 3
    capsys.readouterr()

    words = ['replay', *inputs, *patient, '--live', '-o', str(out)]
    assert main(words) == 3
    lines = capsys.readouterr().out.splitlines()[:2]
    for name, line in zip(('cut', 'hole'), lines, strict=True):
        live, offline = (json.loads((tmp_path / run / name / 'summary.json').read_text())
                         for run in ('live', 'offline'))
        assert live['damaged'] == offline['damaged']
        assert (live['answered'], live['source_frames']) == (offline['frames'], offline['source_frames'])
        assert live['bad_frames'] == offline['bad_frames']
        assert line.startswith(f'{out}/{name}: {live["frames"]} images, {live["answered"]} answers, latency ')
        assert line.endswith(f'; {live["damaged"]}')
        assert rows(out / name) == rows(tmp_path / 'offline' / name)
    assert lines[0].endswith('; cut.mcap: the end is missing (recording was cut off)')
    assert lines[1].endswith('; hole.mcap: 1 unreadable chunk(s) skipped, 1 of 25 messages missing')
    assert [entry['state'] for entry in json.loads((out / 'replay.json').read_text())['inputs']] == ['partial'] * 2
    assert main(words) == 3
    assert capsys.readouterr().out.splitlines()[:2] == [f'{line} (finished earlier)' for line in lines]
    assert main([*words[:1], inputs[0], *words[3:-1], str(out / 'cut')]) == 3, 'one input by itself'


def test_a_bag_without_an_image_that_can_be_read_is_one_line(tmp_path: Path, capsys: pytest.CaptureFixture[str]):
    bag = tmp_path / 'a.mcap'
    with BagWriter(bag, compress=False) as writer:  # all in one chunk
        for index in range(3):
            writer.write_image(scene(index), (index + 1) * PERIOD_NS)
    content, pixels = bag.read_bytes(), scene(0).tobytes()
    at = content.index(pixels)
    bag.write_bytes(content[:at] + bytes(len(pixels)) + content[at + len(pixels):])
    assert main(['replay', str(bag), '--live', '-o', str(tmp_path / 'o')]) == 2
    assert capsys.readouterr().err == (
        f'error: {bag}: expected images on /image_raw, found none that can be read; a.mcap: 1 unreadable chunk(s) '
        'skipped, 3 of 3 messages missing\n')
    assert not (tmp_path / 'o').exists()


def live_process(*words: str) -> subprocess.Popen[str]:
    """``replay --live`` as a process with a group of its own, in the domain of this one."""
    command = [sys.executable, '-m', 'motion_detect_ros', 'replay', '--live', *words]
    return subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True, start_new_session=True,
                            env={**os.environ, 'ROS_DOMAIN_ID': str(own_domain())})


def assert_nobody_left(group: int) -> None:
    with pytest.raises(ProcessLookupError):
        os.killpg(group, 0)


def test_an_interrupted_playback_keeps_its_answers_and_is_played_anew(
    patient: list[str], tmp_path: Path, capsys: pytest.CaptureFixture[str],
):
    """SIGINT to the one process, as ``kill -INT`` sends it: the player must be told, and not play on."""
    bags, out, frames = tmp_path / 'bags', tmp_path / 'out', 60
    bags.mkdir()
    for name in 'ab':
        write_scene(bags / f'{name}.mcap', frames)
    with peer_here() as peer:
        answers = peer.subscribe(topics.DETECTIONS.kind, '/detections')
        running = live_process(str(bags), *patient, '-o', str(out))
        assert peer.until(lambda: len(answers) > 5 or running.poll() is not None)
        running.send_signal(signal.SIGINT)
        assert peer.until(lambda: running.poll() is not None)
    stdout, stderr = running.communicate()
    assert (running.returncode, stdout, own_lines(stderr)) == (
        3, '', ['interrupted; what was written so far is kept in the .part files'])
    assert_nobody_left(running.pid)
    assert len(answers) < frames
    summary = json.loads((out / 'a' / 'summary.json').read_text())
    with BagReader(out / 'a' / 'detections.mcap.part') as reader:
        assert 1 < len([*reader.messages(['/detections'])]) == summary['answered'] < summary['frames'] == frames
        assert reader.damaged is None
    assert sorted(path.name for path in (out / 'a').iterdir()) == [
        'detections.csv.part', 'detections.mcap.part', 'summary.json']
    assert not (out / 'b').exists(), 'none is played after it'
    assert [entry['state'] for entry in json.loads((out / 'replay.json').read_text())['inputs']] == ['partial'] * 2

    write_scene(bags / 'b.mcap', FRAMES)
    assert main(['replay', '--live', str(bags), *patient, '-o', str(out)]) == 0
    lines = capsys.readouterr().out.splitlines()
    assert lines[0] == f'{out}/a: incomplete, done anew'
    assert lines[1].startswith(f'{out}/a: {frames} images, {frames} answers')
    assert sorted(path.name for path in (out / 'a').iterdir()) == ['detections.csv', 'detections.mcap', 'summary.json']


def test_a_node_that_dies_in_playback_leaves_what_was_answered(patient: list[str], tmp_path: Path):
    write_scene(tmp_path / 'a.mcap', 60)
    out = tmp_path / 'out'
    with peer_here() as peer:
        answers = peer.subscribe(topics.DETECTIONS.kind, '/detections')
        running = live_process(str(tmp_path / 'a.mcap'), *patient, '-o', str(out))
        assert peer.until(lambda: len(answers) > 20 or running.poll() is not None)
        children = Path(f'/proc/{running.pid}/task/{running.pid}/children').read_text().split()
        node, = (int(child) for child in children
                 if b'motion_detect_ros.nodes.optical_flow' in Path(f'/proc/{child}/cmdline').read_bytes())
        os.kill(node, signal.SIGKILL)
        assert peer.until(lambda: running.poll() is not None)
    _, stderr = running.communicate()
    assert_nobody_left(running.pid)
    answered = json.loads((out / 'summary.json').read_text())['answered']
    assert 5 < answered < 60
    assert running.returncode == 3
    assert stderr == (f'error: optical_flow: ended with exit code -9; {answered} answers are kept in the .part files\n')
    with BagReader(out / 'detections.mcap.part') as reader:
        assert len([*reader.messages(['/detections'])]) == answered
    assert sorted(path.name for path in out.iterdir()) == [
        'detections.csv.part', 'detections.mcap.part', 'summary.json']


def test_the_nodes_of_a_killed_run_keep_their_domain(tmp_path: Path):
    """Else the next run would hear them."""
    write_scene(tmp_path / 'a.mcap', FRAMES)
    variables = {**os.environ, 'TMPDIR': str(tmp_path)}
    variables.pop('ROS_DOMAIN_ID', None)
    command = [sys.executable, '-m', 'motion_detect_ros', 'replay', '--live', str(tmp_path / 'a.mcap'), '-o',
               str(tmp_path / 'out')]
    running = subprocess.Popen(command, env=variables, start_new_session=True)
    try:
        children, deadline = Path(f'/proc/{running.pid}/task/{running.pid}/children'), time.monotonic() + TIMEOUT_S
        while len(children.read_text().split()) < 3:
            assert time.monotonic() < deadline
            time.sleep(0.05)
        running.kill()
        running.wait()
        lock, = tmp_path.glob('*.lock')
        with lock.open() as file, pytest.raises(BlockingIOError):
            fcntl.flock(file, fcntl.LOCK_EX | fcntl.LOCK_NB)
    finally:
        os.killpg(running.pid, signal.SIGKILL)


@pytest.mark.parametrize('send', [os.kill, os.killpg])
def test_an_interrupt_while_the_nodes_start_writes_nothing_and_says_so(
    send: Callable[[int, signal.Signals], None], tmp_path: Path, monkeypatch: pytest.MonkeyPatch,
):
    """To the one process, and to its group, as a terminal sends it. No folder of the nodes' logs is left."""
    monkeypatch.setenv('TMPDIR', str(tmp_path))
    write_scene(tmp_path / 'a.mcap', FRAMES)
    running = live_process(str(tmp_path / 'a.mcap'), '-o', str(tmp_path / 'out'))
    children, deadline = Path(f'/proc/{running.pid}/task/{running.pid}/children'), time.monotonic() + TIMEOUT_S
    while not children.read_text():
        assert time.monotonic() < deadline
        assert running.poll() is None
        time.sleep(0.01)
    send(running.pid, signal.SIGINT)
    _, stderr = running.communicate(timeout=TIMEOUT_S)
    assert (running.returncode, stderr) == (
        3, f'interrupted; {tmp_path}/out: no image was answered yet, nothing was written\n')
    assert_nobody_left(running.pid)
    assert not (tmp_path / 'out').exists()
    assert not [path for path in tmp_path.iterdir() if path.is_dir()]


def test_all_images_are_answered_however_fast_they_are_played(tmp_path: Path, capsys: pytest.CaptureFixture[str]):
    """Two hundred images a second are more than the stages can do on any machine this runs on: the player waits."""
    write_scene(tmp_path / 'a.mcap', 300)
    words = ['replay', str(tmp_path / 'a.mcap'), '--no-report', '-o']
    assert main([*words, str(tmp_path / 'live'), '--live', '--rate', '20']) == 0, capsys.readouterr().out
    summary = json.loads((tmp_path / 'live' / 'summary.json').read_text())
    assert (summary['wanted'], summary['answered'], summary['left_out']) == (300, 300, {})
    assert summary['held_s'] > 0.0
    assert f', held back for {summary["held_s"]:.1f} s' in capsys.readouterr().out
    assert main([*words, str(tmp_path / 'offline')]) == 0
    assert rows(tmp_path / 'live') == rows(tmp_path / 'offline')


def test_compressed_images_are_all_answered_too(tmp_path: Path):
    with BagWriter(tmp_path / 'a.mcap') as bag:
        for index in range(200):
            stamp_ns = (index + 1) * PERIOD_NS
            bag.write_raw('/camera/image_raw/compressed', COMPRESSED_IMAGE, png(index % 40, stamp_ns), stamp_ns)
    assert main(['replay', str(tmp_path / 'a.mcap'), '--live', '--rate', '20', '-o', str(tmp_path / 'live')]) == 0
    assert json.loads((tmp_path / 'live' / 'summary.json').read_text())['answered'] == 200


def test_short_queues_of_the_settings_lose_images_which_are_told_by_stage(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch,
):
    """As with a camera, which waits for nobody."""
    monkeypatch.setattr('motion_detect_ros.cli.live.IDLE_TIMEOUT_S', 6.0)
    write_scene(tmp_path / 'a.mcap', 100)
    (tmp_path / 'short.yaml').write_text(yaml.safe_dump({'/**': {'ros__parameters': {'queue_size': 1}}}))
    assert main(['replay', str(tmp_path / 'a.mcap'), '--config', str(tmp_path / 'short.yaml'), '--live', '--rate', '20',
                 '-o', str(tmp_path / 'live')]) == 3
    summary = json.loads((tmp_path / 'live' / 'summary.json').read_text())
    assert summary['held_s'] == 0.0
    left_out = summary['left_out']
    assert sum(left_out.values()) == 100 - summary['answered'] > 0
    assert left_out['ego_motion'] > 0
    assert set(left_out) <= {'ego_motion', 'optical_flow', 'art2_clustering', 'transport'}
    told = ', '.join(f'{count} by {stage}' for stage, count in left_out.items())
    assert f'100 images, {summary["answered"]} answers, {sum(left_out.values())} left out ({told})' in (
        capsys.readouterr().out)


def test_what_the_load_leaves_out_is_told_apart(tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    """Two hundred images a second for five seconds, of which one of two or three is worked on in the end."""
    monkeypatch.setattr('motion_detect_ros.cli.live.IDLE_TIMEOUT_S', 6.0)
    write_scene(tmp_path / 'a.mcap', 1000)
    (tmp_path / 'adapt.yaml').write_text(yaml.safe_dump({'/**': {'ros__parameters': {'load': {'adapt': True}}}}))
    main(['replay', str(tmp_path / 'a.mcap'), '--config', str(tmp_path / 'adapt.yaml'), '--live', '--rate', '20', '-o',
          str(tmp_path / 'live')])
    summary = json.loads((tmp_path / 'live' / 'summary.json').read_text())
    assert summary['held_s'] == 0.0
    assert summary['left_out']['load.adapt'] > 50
    assert sum(summary['left_out'].values()) == 1000 - summary['answered']


@pytest.mark.parametrize('name', ['/1cam/image_raw', '/front camera/image_raw', '/cam//image_raw', '/{node}/image'])
def test_a_name_that_ros_refuses_is_one_line_before_anything_starts(
    name: str, tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch,
):
    """No node would come up in no time at all."""
    monkeypatch.setattr('motion_detect_ros.cli.live.START_TIMEOUT_S', 0.0)
    with BagWriter(tmp_path / 'a.mcap') as bag:
        for index in range(3):
            bag.write(name, image(scene(index), (index + 1) * PERIOD_NS, 'camera'), (index + 1) * PERIOD_NS)
    assert main(['replay', str(tmp_path / 'a.mcap'), '--live', '-o', str(tmp_path / 'out')]) == 2
    assert capsys.readouterr().err == (
        f'error: {tmp_path}/a.mcap: --live expected topics with names of letters, digits and _, their parts joined by '
        f'/ and none beginning with a digit, got {name}\n')
    assert not (tmp_path / 'out').exists()


def test_a_long_name_is_played_whatever_the_file_says_of_single_nodes(tmp_path: Path):
    """Too long for a topic of ROS; the player gives its messages another one. What arrives is for the bag to say."""
    settings = tmp_path / 'mine.yaml'
    everybody = '/**: {ros__parameters: {art2.vigilance: 0.3}}\n'
    settings.write_text(everybody + ''.join(
        f'/{node}: {{ros__parameters: {{image_transport: compressed, first_id: {first}}}}}\n'
        for first, node in enumerate(STAGES, start=70)))
    with BagWriter(tmp_path / 'a.mcap') as bag:
        for index in range(3):
            bag.write_image(scene(index), (index + 1) * PERIOD_NS, f'/{"camera" * 50}/image_raw')
    words = ['replay', str(tmp_path / 'a.mcap'), '--live', '--config', str(settings), '-o', str(tmp_path / 'out')]
    assert main(words) == 0
