"""A full disk, a folder that cannot be written, an input that goes: one clear line, what was written is readable."""

from __future__ import annotations

import csv
import json
import os
import resource
import shutil
import subprocess
import sys
from collections.abc import Iterator
from functools import partial
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest
from batch_flights import PATIENCE_S, PERIOD_NS, write_flight

from motion_detect_ros.__main__ import main
from motion_detect_ros.cli.batch import one_input
from motion_detect_ros.cli.batch.jobs import PARTIAL, Job
from motion_detect_ros.cli.batch.one_input import run_job
from motion_detect_ros.core.config import PipelineConfig
from motion_detect_ros.sources import messages
from motion_detect_ros.sources.bag_reader import BagReader
from motion_detect_ros.sources.bag_writer import BagWriter
from motion_detect_ros.sources.raw import RawMessage

pytestmark = pytest.mark.messages

TEXTURE = np.random.default_rng(0).integers(0, 256, (96, 128), np.uint8)


def test_a_full_disk_ends_that_input_in_one_line(tmp_path: Path):
    """A limit on the size of files stands in for the disk: the kernel refuses what goes over it, in mid-write."""
    bag, out = write_flight(tmp_path / 'a.mcap', frames=80), tmp_path / 'out'
    allow = partial(resource.setrlimit, resource.RLIMIT_FSIZE, (8000, 8000))
    done = subprocess.run([sys.executable, '-B', '-m', 'motion_detect_ros', 'replay', str(bag), '-o', str(out)],
                          preexec_fn=allow, capture_output=True, text=True, timeout=PATIENCE_S, check=False)
    assert (done.returncode, done.stdout) == (3, ''), done.stderr
    frames = len((out / 'frames.csv.part').read_text().splitlines()) - 1
    assert 0 < frames < 80
    assert done.stderr == (f'error: {out}: cannot be written: File too large; '
                           f'{frames} frames are kept in the .part files\n')
    for name in ('frames.csv.part', 'times.csv.part', 'detections.csv.part'):
        with (out / name).open() as stream:
            rows = [*csv.reader(stream)]
        assert len({len(row) for row in rows}) == 1, 'no half row'
    with BagReader(out / 'detections.mcap.part') as reader:
        assert len([*reader.messages()]) > 0
    assert json.loads((out / 'summary.json').read_text())['complete'] is False


@pytest.mark.parametrize('words', [[], ['--workers', '2'], ['--scheduler', 'tcp://127.0.0.1:1']])
def test_a_folder_that_nobody_can_write(words: list[str], tmp_path: Path, capsys: pytest.CaptureFixture[str]):
    """/sys takes no folders, not of root either."""
    if '--scheduler' in words:
        pytest.importorskip('distributed', reason='Dask is an extra')
    bags = [str(write_flight(tmp_path / name, frames=2)) for name in ('a.mcap', 'b.mcap')]
    code = main(['replay', *bags[:1 if not words else 2], '-o', '/sys/motion_detect_ros', *words])
    lines = capsys.readouterr().err.splitlines()
    assert code == 2
    assert len(lines) == (2 if '--workers' in words else 1)
    assert all('cannot be made a folder for the outputs: ' in line for line in lines)


def pictures(folder: Path, count: int) -> Path:
    folder.mkdir()
    for index in range(count):
        cv2.imwrite(str(folder / f'{index}.png'), np.roll(TEXTURE, index, axis=1))
    return folder


def bag_of_pictures(path: Path, readable: list[bool]) -> Path:
    with BagWriter(path) as bag:
        for index, good in enumerate(readable):
            stamp_ns = 10**18 + index * PERIOD_NS
            picture = messages.serialize(messages.image(np.roll(TEXTURE, index, axis=1), stamp_ns, 'camera'))
            bag.write_raw('/image_raw', messages.IMAGE, picture if good else picture[:50], stamp_ns)
    return path


@pytest.mark.parametrize(('readable', 'bad'), [([True, True, False, True, False], 2), ([True, True, True, False], 1)])
@pytest.mark.parametrize('kind', ['pictures', 'bag'])
def test_unreadable_frames_at_the_end_are_frames_of_the_source(
    tmp_path: Path, kind: str, readable: list[bool], bad: int,
):
    if kind == 'bag':
        source = bag_of_pictures(tmp_path / 'a.mcap', readable)
    else:
        source = pictures(tmp_path / 'p', len(readable))
        for index in [index for index, good in enumerate(readable) if not good]:
            (source / f'{index}.png').write_bytes(b'no picture')
    assert run_job(Job(str(source), tmp_path / 'out', PipelineConfig())).exit_code == PARTIAL
    summary = json.loads((tmp_path / 'out' / 'summary.json').read_text())
    assert (summary['source_frames'], summary['frames'], summary['bad_frames']) == (
        len(readable), len(readable) - bad, bad)
    (warning,) = summary['warnings']
    assert warning.startswith(f'the first bad one, frame {readable.index(False)}: ')


@pytest.mark.parametrize(('window', 'expected'), [
    ({'every': 3}, 8), ({'every': 4}, 8), ({'start_s': 0.1}, 8), ({'duration_s': 0.2}, 4)])
@pytest.mark.parametrize('kind', ['pictures', 'bag', 'video'])
def test_frames_left_out_at_the_end_are_frames_of_the_source(
    tmp_path: Path, kind: str, window: dict[str, Any], expected: int,
):
    """Eight frames of 20 frames/s; those after the end of a window are not looked at."""
    if kind == 'bag':
        source = bag_of_pictures(tmp_path / 'a.mcap', [True] * 8)
    elif kind == 'pictures':
        source = pictures(tmp_path / 'p', 8)
    else:
        source = tmp_path / 'a.avi'
        video = cv2.VideoWriter(str(source), cv2.VideoWriter.fourcc(*'MJPG'), 20.0, TEXTURE.shape[::-1])
        for index in range(8):
            video.write(cv2.cvtColor(np.roll(TEXTURE, index, axis=1), cv2.COLOR_GRAY2BGR))
        video.release()
    fps = 20.0 if kind == 'pictures' else None
    assert run_job(Job(str(source), tmp_path / 'out', PipelineConfig(), fps=fps, **window)).exit_code == 0
    assert json.loads((tmp_path / 'out' / 'summary.json').read_text())['source_frames'] == expected


def test_a_link_to_a_picture_that_is_not_there_uses_its_number_up(tmp_path: Path, capsys: pytest.CaptureFixture[str]):
    """As of git-annex before the content was fetched: the truth of a data set goes by the places of its pictures."""
    source = pictures(tmp_path / 'p', 5)
    (source / '2.png').unlink()
    (source / '2.png').symlink_to(tmp_path / 'annex' / 'objects' / 'x')
    assert main(['replay', str(source), '-o', str(tmp_path / 'out'), '--no-report']) == 3
    line = capsys.readouterr().out
    assert '4 frames' in line and '1 bad frames left out; the first bad one, frame 2: ' in line
    summary = json.loads((tmp_path / 'out' / 'summary.json').read_text())
    assert (summary['source_frames'], summary['frames'], summary['bad_frames']) == (5, 4, 1)
    with (tmp_path / 'out' / 'frames.csv').open() as file:
        assert [row['frame'] for row in csv.DictReader(file)] == ['0', '1', '3', '4']


def test_why_no_frame_could_be_used_is_said(tmp_path: Path, capsys: pytest.CaptureFixture[str]):
    """Of the source, and of the detector."""
    with BagWriter(tmp_path / 'bayer.mcap') as bag:
        for index in range(3):
            message = messages.image(np.zeros((40, 60), np.uint8), 10**9 + index * 10**8, 'camera')
            message.encoding = 'bayer_rggb16'
            bag.write('/image_raw', message, 10**9 + index * 10**8)
    with BagWriter(tmp_path / 'flat.mcap') as bag:
        for index in range(3):
            bag.write_image(np.zeros((3, 60), np.uint8), 10**9 + index * 10**8)
    for name, reason in (('bayer', "got 'bayer_rggb16'"), ('flat', 'got 60x3')):
        assert main(['replay', str(tmp_path / f'{name}.mcap'), '-o', str(tmp_path / name), '--no-report']) == 1
        line = capsys.readouterr().out
        assert '3 bad frames left out; the first bad one, frame 0: ' in line
        assert reason in line


def test_a_recording_most_of_whose_frames_cannot_be_used_for_their_stamps_is_not_done(
    tmp_path: Path, capsys: pytest.CaptureFixture[str],
):
    """A driver that stamps nothing; pictures that all come twice are in order."""
    for name, stamps, code in (('none', [0] * 6, 3), ('twice', [1, 1, 2, 2, 3, 3], 0)):
        with BagWriter(tmp_path / f'{name}.mcap') as bag:
            for index, stamp in enumerate(stamps):
                bag.write('/image_raw', messages.image(TEXTURE, stamp * 10**8, 'camera'), 10**9 + index * 10**8)
        assert main(['replay', str(tmp_path / f'{name}.mcap'), '-o', str(tmp_path / name), '--no-report']) == code
        assert 'left out, their stamps were seen already' in capsys.readouterr().out


def test_an_input_that_goes_before_it_is_begun_costs_itself_only(tmp_path: Path, capsys: pytest.CaptureFixture[str]):
    bag = write_flight(tmp_path / 'a.mcap', frames=3)
    assert main(['replay', str(bag), str(tmp_path / 'gone.mcap'), '-o', str(tmp_path / 'out')]) == 3
    captured = capsys.readouterr()
    assert captured.err == f'error: {tmp_path}/gone.mcap: no such file or folder\n'
    assert captured.out.splitlines()[1:] == [
        '2 inputs: 1 done, 1 failed', f'failed: {tmp_path}/gone.mcap: no such file or folder']


def test_a_folder_of_pictures_that_goes_in_mid_run(tmp_path: Path):
    folder = pictures(tmp_path / 'p', 12)

    def watch(done: int, total: int | None) -> None:
        if done == 3 and folder.exists():
            shutil.rmtree(folder)

    outcome = run_job(Job(str(folder), tmp_path / 'out', PipelineConfig()), watch)
    frames = json.loads((tmp_path / 'out' / 'summary.json').read_text())['frames']
    assert 3 <= frames < 12
    assert (outcome.exit_code, outcome.line) == (PARTIAL, (
        f'error: {folder}: the folder has gone while it was read; {frames} frames are kept in the .part files'))
    assert len((tmp_path / 'out' / 'frames.csv.part').read_text().splitlines()) == frames + 1
    with BagReader(tmp_path / 'out' / 'detections.mcap.part') as reader:
        assert len([*reader.messages(['/detections'])]) == frames


def test_a_bag_on_a_drive_that_goes_in_mid_run(tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    """As the kernel says it of a medium that was taken out."""
    bag, read = write_flight(tmp_path / 'a.mcap'), BagReader.messages

    def going(self: BagReader, topics: list[str] | None = None) -> Iterator[RawMessage]:
        for index, message in enumerate(read(self, topics)):
            if index == 6:
                raise OSError(5, os.strerror(5))
            yield message

    monkeypatch.setattr(BagReader, 'messages', going)
    outcome = run_job(Job(str(bag), tmp_path / 'out', PipelineConfig()))
    assert (outcome.exit_code, outcome.line) == (PARTIAL, (
        f'error: {bag}: cannot be read any more: Input/output error; 6 frames are kept in the .part files'))


def test_a_bag_that_is_deleted_in_mid_run_is_read_to_its_end(tmp_path: Path):
    bag = write_flight(tmp_path / 'a.mcap')
    job = Job(str(bag), tmp_path / 'out', PipelineConfig())
    outcome = run_job(job, lambda done, total: bag.unlink(missing_ok=True))
    assert outcome.exit_code == 0
    assert json.loads((tmp_path / 'out' / 'summary.json').read_text())['frames'] == 20


def test_a_defect_in_one_input_does_not_stop_the_others(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str],
):
    bags = [str(write_flight(tmp_path / f'{name}.mcap', frames=3)) for name in 'ab']

    def failing(*_: object, **__: object) -> None:
        monkeypatch.undo()
        raise ZeroDivisionError('by nothing')

    monkeypatch.setattr(one_input, 'MotionPipeline', failing)
    assert main(['replay', *bags, '-o', str(tmp_path / 'out')]) == 3
    captured = capsys.readouterr()
    assert f'failed: {bags[0]}: ZeroDivisionError: by nothing' in captured.out
    assert 'Traceback' in captured.err
    assert (tmp_path / 'out' / 'b' / 'detections.csv').is_file()
