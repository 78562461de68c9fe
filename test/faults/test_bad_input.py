"""Bad input ends with exit code 2 and one line that says what is wrong and what would be right."""

from __future__ import annotations

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

from motion_detect_ros.sources import messages
from motion_detect_ros.sources.bags import BagReader, BagWriter


def run(*words: str | Path) -> subprocess.CompletedProcess[str]:
    """The command line as users run it: another process."""
    return subprocess.run([sys.executable, '-m', 'motion_detect_ros', *map(str, words)],
                          capture_output=True, text=True, timeout=600, check=False)


def a_bag(folder: Path) -> Path:
    with BagWriter(folder / 'a.mcap') as writer:
        for index in range(3):
            writer.write_image(np.zeros((64, 96, 3), np.uint8), index * 10**8)
            writer.write_image(np.zeros((64, 96), np.uint8), index * 10**8, '/rear/image_raw')
    return folder / 'a.mcap'


def empty_bag(folder: Path) -> Path:
    with BagWriter(folder / 'empty.mcap'):
        pass
    return folder / 'empty.mcap'


def loop(folder: Path) -> Path:
    """A link that leads to itself."""
    (folder / 'loop').symlink_to(folder / 'loop')
    return folder / 'loop'


def named(folder: Path, name: str, content: bytes = b'') -> Path:
    (folder / name).write_bytes(content)
    return folder / name


Case = tuple[Callable[[Path], list[str | Path]], str]
CASES: dict[str, Case] = {
    'missing file': (lambda d: ['replay', d / 'no.mcap', '-o', d / 'o'], 'no.mcap: no such file or folder'),
    'wrong topic': (lambda d: ['replay', a_bag(d), '-o', d / 'o', '--topic', '/front/image_raw'],
                    "no image topic '/front/image_raw'; image topics (type, messages): "
                    '/image_raw (sensor_msgs/msg/Image, 3), /rear/image_raw (sensor_msgs/msg/Image, 3)'),
    'topic not chosen': (lambda d: ['replay', a_bag(d), '-o', d / 'o'], 'choose one: --topic'),
    'empty bag': (lambda d: ['replay', empty_bag(d), '-o', d / 'o'], 'the bag is empty'),
    'file of no bytes': (lambda d: ['replay', named(d, 'a.mcap'), '-o', d / 'o'], '0 bytes that are no bag'),
    'broken db3': (lambda d: ['replay', named(d, 'a.db3', b'SQLite format 3\x00' + b'x' * 500), '-o', d / 'o'],
                   'a.db3: not a readable bag'),
    'broken video': (lambda d: ['replay', named(d, 'a.mp4', b'\0' * 999), '-o', d / 'o'],
                     'a.mp4: cannot be opened as a video'),
    'empty folder': (lambda d: ['replay', d, '-o', d / 'o'], 'found nothing; expected pictures'),
    'wrong VisDrone folder': (lambda d: ['convert', 'visdrone', d, '-o', d / 'o.mcap'],
                              'found nothing; expected a sequence folder with pictures 0000001.jpg'),
    'wrong KITTI folder': (lambda d: ['convert', 'kitti', d, '-o', d / 'o.mcap'],
                           'expected a KITTI raw drive: image_02/data'),
    'missing folder': (lambda d: ['convert', 'images', d / 'no', '-o', d / 'o.mcap', '--fps', '9'], 'no such folder'),
    'rate of zero': (lambda d: ['convert', 'images', d, '-o', d / 'o.mcap', '--fps', '0'], 'expected a number over 0'),
    'missing preset': (lambda d: ['replay', a_bag(d), '-o', d / 'o', '--preset', 'submarine'], 'submarine'),
    'output folder is a file': (lambda d: ['replay', a_bag(d), '--topic', 'image_raw', '-o', named(d, 'o')], '/o: '),
    'input in circles': (lambda d: ['replay', loop(d), '-o', d / 'o'], 'loop: expected a file or folder, got a'),
    'file in circles': (lambda d: ['replay', a_bag(d), loop(d) / 'a.mcap', '-o', d / 'o'], 'loop/a.mcap: expected a'),
    'output in circles': (lambda d: ['replay', a_bag(d), '--topic', 'image_raw', '-o', loop(d)], 'loop: expected a'),
    'outputs in circles': (lambda d: ['tune', a_bag(d), '-o', loop(d) / 'o'], 'loop/o: expected a file or folder'),
    'missing truth': (lambda d: ['evaluate', named(d, 'd.csv', b'frame,x,y,w,h\n'), '--truth', d / 'no.txt'],
                      'no.txt: truth cannot be read'),
    'detections without boxes': (lambda d: ['evaluate', named(d, 'd.csv', b'frame,x,y\n'), '--truth',
                                            named(d, 't.csv', b'frame,id,x,y,w,h\n')], 'column w, h is missing'),
    'inspect of a text': (lambda d: ['inspect', named(d, 'a.mcap', b'text')], '4 bytes that are no bag'),
    'unknown command': (lambda d: ['destroy'], 'invalid choice'),
    'no command': (lambda d: [], 'required: COMMAND'),
    'missing argument': (lambda d: ['replay', d], '-o/--output'),
}


@pytest.mark.parametrize('name', CASES)
def test_bad_input_is_one_line_and_exit_code_2(name: str, tmp_path: Path) -> None:
    words, message = CASES[name]
    done = run(*words(tmp_path))
    assert done.returncode == 2, done.stderr
    assert len(done.stderr.splitlines()) == 1, done.stderr
    assert message in done.stderr
    assert done.stdout == ''


def test_a_malformed_image_costs_that_frame_only(tmp_path: Path) -> None:
    path = tmp_path / 'a.mcap'
    texture = np.random.default_rng(0).integers(0, 256, (96, 128), np.uint8)
    with BagWriter(path) as writer:
        for index in range(5):
            if index == 2:
                writer.write_raw('/image_raw', 'sensor_msgs/msg/Image', b'\x00\x01\x00\x00 torn', index * 10**8)
            else:
                writer.write_image(np.roll(texture, index, axis=1), index * 10**8)
    done = run('replay', path, '-o', tmp_path / 'o')
    assert done.returncode == 3, done.stderr
    assert '4 frames' in done.stdout
    assert '1 bad frames left out' in done.stdout
    with BagReader(tmp_path / 'o' / 'detections.mcap') as bag:
        assert [m.log_stamp_ns // 10**8 for m in bag.messages(['/detections'])] == [0, 1, 3, 4]


@pytest.mark.parametrize('number', [signal.SIGINT, signal.SIGTERM])
def test_ctrl_c_keeps_what_was_converted(tmp_path: Path, number: signal.Signals) -> None:
    folder = tmp_path / 'pictures'
    folder.mkdir()
    cv2.imwrite(str(folder / '0000.png'), np.random.default_rng(0).integers(0, 256, (1080, 1920, 3), np.uint8))
    for index in range(1, 400):  # as links: 400 large pictures take seconds to convert and no space
        os.link(folder / '0000.png', folder / f'{index:04d}.png')
    out = tmp_path / 'out.mcap'
    process = subprocess.Popen(
        [sys.executable, '-m', 'motion_detect_ros', 'convert', 'images', str(folder), '-o', str(out), '--fps', '30'],
        stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True)
    try:
        part = tmp_path / 'out.mcap.part'
        deadline = time.monotonic() + 300
        while not (part.exists() and part.stat().st_size > 20_000_000) and time.monotonic() < deadline:
            time.sleep(0.01)
        process.send_signal(number)
        _, errors = process.communicate(timeout=600)
    finally:
        process.kill()
    assert process.returncode == 3
    assert errors == 'interrupted; what was written so far is kept in the .part files\n'
    assert not out.exists()
    with BagReader(part) as bag:
        assert bag.damaged is None
        assert sum(topic.count for topic in bag.topics) >= 6


def test_a_stamp_that_no_message_can_carry_costs_that_frame_only(tmp_path: Path) -> None:
    """The largest one that the bytes of a header have room for."""
    texture = np.random.default_rng(0).integers(0, 256, (96, 128), np.uint8)
    with BagWriter(tmp_path / 'a.mcap') as writer:
        for index in range(6):
            image = messages.image(np.roll(texture, index, axis=1), index * 10**8, 'camera')
            if index == 3:
                image.header.stamp.sec, image.header.stamp.nanosec = 2**31 - 1, 2**32 - 1
            writer.write('/image_raw', image, index * 10**8)
    done = run('replay', tmp_path / 'a.mcap', '-o', tmp_path / 'o')
    assert done.returncode == 0, done.stderr
    assert '5 frames' in done.stdout
    assert '1 left out, their stamps were seen already, late or out of range' in done.stdout
    with BagReader(tmp_path / 'o' / 'detections.mcap') as bag:
        assert [m.log_stamp_ns // 10**8 for m in bag.messages(['/detections'])] == [0, 1, 2, 4, 5]


@pytest.fixture
def five_pictures(tmp_path: Path) -> Path:
    folder = tmp_path / 'pictures'
    folder.mkdir()
    for index in range(5):
        cv2.imwrite(str(folder / f'{index}.png'), np.random.default_rng(index).integers(0, 256, (96, 128), np.uint8))
    return folder


def test_a_rate_that_leads_beyond_what_stamps_can_hold(five_pictures: Path, tmp_path: Path) -> None:
    """At 1e-9 Hz the fourth picture is of 2065."""
    done = run('replay', five_pictures, '-o', tmp_path / 'o', '--fps', '1e-9')
    assert done.returncode == 0, done.stderr
    assert '3 frames' in done.stdout
    assert '2 left out, their stamps' in done.stdout
    done = run('convert', 'images', five_pictures, '-o', tmp_path / 'o.mcap', '--fps', '1e-9')
    assert done.returncode == 2
    assert done.stderr == 'error: stamp: expected seconds from -2147483648 to 2147483647, got 3000000001\n'
