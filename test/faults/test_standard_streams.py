"""Standard output and error that are closed, full, or whose reader has gone."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
from pathlib import Path

import cv2
import numpy as np
import pytest

from motion_detect_ros.sources.bags import BagReader, BagWriter


@pytest.fixture
def words(tmp_path: Path) -> list[str]:
    """A command that prints a few lines."""
    (tmp_path / 'found.csv').write_text('frame,x,y,w,h\n0,1,1,2,2\n')
    (tmp_path / 'truth.csv').write_text('frame,id,x,y,w,h\n0,1,1,1,2,2\n')
    return ['evaluate', str(tmp_path / 'found.csv'), '--truth', str(tmp_path / 'truth.csv'), '--skip', '0']


def start(words: list[str], before: str = '', after: str = '', **streams: object) -> subprocess.Popen[str]:
    """The command in a shell, buffered as it is for users, with redirections ``after`` it."""
    surroundings = {name: value for name, value in os.environ.items() if name != 'PYTHONUNBUFFERED'}
    return subprocess.Popen(['bash', '-c', f'{before} exec "$@" {after}', 'bash', sys.executable, '-m',
                             'motion_detect_ros', *words], env=surroundings, text=True, **streams)  # type: ignore


def test_a_reader_that_has_gone_is_no_error(words: list[str]) -> None:
    process = start(words, stdout=subprocess.PIPE, stderr=subprocess.PIPE)
    assert process.stdout is not None and process.stderr is not None
    process.stdout.close()
    assert process.stderr.read() == ''
    assert process.wait(60) == 0


def test_a_full_disk_behind_the_output_is_said_once(words: list[str]) -> None:
    process = start(words, after='> /dev/full', stderr=subprocess.PIPE)
    _, said = process.communicate(timeout=60)
    assert (process.returncode, said) == (3, 'error: [Errno 28] No space left on device\n')


@pytest.mark.parametrize('closed', ['2>&-', '>&-', '0<&- >&- 2>&-'])
def test_closed_streams(tmp_path: Path, closed: str) -> None:
    """Nothing is said, all is done; no file gets the number of a closed stream, on which libraries in C write."""
    (tmp_path / 'pictures').mkdir()
    for frame in range(3):
        cv2.imwrite(str(tmp_path / f'pictures/{frame}.png'), np.zeros((48, 64), np.uint8))
    bag = tmp_path / 'a.mcap'
    process = start(['convert', 'images', str(tmp_path / 'pictures'), '--fps', '10', '-o', str(bag)], after=closed)
    assert process.wait(60) == 0
    assert sum(topic.count for topic in BagReader(bag).topics) == 6


def test_errors_do_not_go_to_the_output_where_stderr_is_closed(tmp_path: Path) -> None:
    process = start(['inspect', str(tmp_path / 'no.mcap')], after='2>&-', stdout=subprocess.PIPE)
    said, _ = process.communicate(timeout=60)
    assert (process.returncode, said) == (2, '')


def test_ctrl_c_promises_nothing_of_a_command_that_writes_nothing(words: list[str], tmp_path: Path) -> None:
    """Its truth comes through a pipe, from a writer that writes nothing."""
    (tmp_path / 'truth.csv').unlink()
    os.mkfifo(tmp_path / 'truth.csv')
    process = start(words, stdout=subprocess.DEVNULL, stderr=subprocess.PIPE)
    with (tmp_path / 'truth.csv').open('wb'):  # waits for the reader
        process.send_signal(signal.SIGINT)
        _, said = process.communicate(timeout=60)
    assert (process.returncode, said) == (3, 'interrupted\n')


@pytest.mark.parametrize(('encoding', 'name', 'shown'), [
    ('utf-8:strict', b'day\xff.mcap', 'day\\udcff.mcap'),  # as in a locale of UTF-8
    ('ascii:strict', 'tägl.mcap'.encode(), 't\\xe4gl.mcap'),
])
def test_names_that_the_output_cannot_hold(tmp_path: Path, encoding: str, name: bytes, shown: str) -> None:
    bag = tmp_path / os.fsdecode(name)
    with BagWriter(bag) as writer:
        writer.write_image(np.zeros((4, 4), np.uint8), 1)
    done = subprocess.run([sys.executable, '-m', 'motion_detect_ros', 'inspect', bag], capture_output=True, text=True,
                          env=os.environ | {'PYTHONIOENCODING': encoding}, timeout=60, check=False)
    assert (done.returncode, done.stderr) == (0, '')
    assert done.stdout.startswith(f'{tmp_path}/{shown}: 1 readable messages')
