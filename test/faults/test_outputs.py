"""Results stay in the folder that was asked for, are not overwritten unasked, and survive a kill."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
import time
from pathlib import Path

import numpy as np
import pytest

from motion_detect_ros.__main__ import main
from motion_detect_ros.cli.output_folders import folders_of
from motion_detect_ros.results.files import OUTPUT_NAMES
from motion_detect_ros.sources.bags import BagReader, BagWriter

TIMEOUT_S = 300.0


def write_bag(path: Path, stamps: list[int]) -> Path:
    texture = np.random.default_rng(0).integers(0, 256, (96, 128), np.uint8)
    with BagWriter(path) as writer:
        for index, stamp in enumerate(stamps):
            writer.write_image(np.roll(texture, index, axis=1), stamp)
    return path


def regular(count: int) -> list[int]:
    return [index * 10**8 for index in range(count)]


@pytest.mark.parametrize('name', ['...mcap', '....mcap', '-.mcap', '. .mcap', 'a\nb.mcap', '~.mcap', '..a.mcap'])
def test_no_name_of_an_input_leads_out_of_the_folder(name: str, tmp_path: Path):
    inputs = [str(tmp_path / name), str(tmp_path / 'plain.mcap')]
    out = tmp_path / 'parent' / 'out'
    folders = folders_of(inputs, out)
    assert [folder.resolve().parent for folder in folders] == [out, out]
    assert all(folder.name.isprintable() and not folder.name.startswith('.') for folder in folders)


def test_folders_of_several_inputs_are_all_different():
    inputs = ['a.mcap', 'x/a.mcap', 'a-2.mcap', 'y/a.mcap', '...mcap', '....mcap']
    assert len(set(folders_of(inputs, Path('out')))) == len(inputs)


def test_a_bag_named_by_dots_leaves_what_is_beside_the_folder_alone(tmp_path: Path, shown):
    for name in ('...mcap', 'b.mcap'):
        write_bag(tmp_path / name, regular(4))
    bystanders = [tmp_path / 'results' / name for name in OUTPUT_NAMES]
    (tmp_path / 'results').mkdir()
    for file in bystanders:
        file.write_text('mine')
    out = tmp_path / 'results' / 'out'
    assert main(['replay', str(tmp_path / '...mcap'), str(tmp_path / 'b.mcap'), '-o', str(out)]) == 0
    assert {file.read_text() for file in bystanders} == {'mine'}
    assert sorted(path.name for path in out.iterdir()) == ['b', 'input', 'replay.json']
    shown('an input named `...mcap`', 'writes inside of the folder that was asked for', 'folder `input`')


@pytest.mark.parametrize('left', [*OUTPUT_NAMES, 'detections.mcap.part'])
def test_existing_results_need_force(left: str, tmp_path: Path, capsys: pytest.CaptureFixture[str], shown):
    bag, out = write_bag(tmp_path / 'a.mcap', regular(4)), tmp_path / 'out'
    out.mkdir()
    (out / left).write_text('mine')
    assert main(['replay', str(bag), '-o', str(out)]) == 2
    assert f'{out / left}: exists; --force overwrites it' in capsys.readouterr().err
    assert [(path.name, path.read_text()) for path in out.iterdir()] == [(left, 'mine')]
    assert main(['replay', str(bag), '-o', str(out), '--force', '--no-report']) == 0
    assert sorted(path.name for path in out.iterdir()) == sorted(OUTPUT_NAMES)
    shown('replay into a folder with results', 'refused without --force, exit code 2', f'`{left}` kept')


def test_convert_overwrites_no_bag_unasked(tmp_path: Path, capsys: pytest.CaptureFixture[str]):
    (tmp_path / 'o.mcap').write_text('mine')
    words = ['convert', 'images', str(tmp_path), '-o', str(tmp_path / 'o.mcap'), '--fps', '9']
    assert main(words) == 2
    assert 'exists; --force' in capsys.readouterr().err
    assert (tmp_path / 'o.mcap').read_text() == 'mine'


def test_images_with_stamps_seen_already_or_late_cost_themselves_only(
    tmp_path: Path, capsys: pytest.CaptureFixture[str],
):
    bag = write_bag(tmp_path / 'a.mcap', [1, *regular(9)[1:5], 4 * 10**8, 6 * 10**8, 5 * 10**8, 7 * 10**8])
    assert main(['replay', str(bag), '-o', str(tmp_path / 'out')]) == 0
    # Messages of a bag come in the order of their recording, which is that of the stamps here: one is seen twice.
    assert '1 left out, their stamps were seen already, late or out of range' in capsys.readouterr().out


@pytest.mark.parametrize('words', [['--fps', 'inf'], ['--fps', 'nan'], ['--rate', 'inf', '--live']])
def test_rates_that_are_none(words: list[str], tmp_path: Path, capsys: pytest.CaptureFixture[str]):
    bag = write_bag(tmp_path / 'a.mcap', regular(3))
    assert main(['replay', str(bag), '-o', str(tmp_path / 'out'), *words]) == 2
    assert 'expected a number over 0' in capsys.readouterr().err


def test_what_a_killed_replay_had_done_is_readable(tmp_path: Path, shown):
    bag, out = write_bag(tmp_path / 'a.mcap', regular(3000)), tmp_path / 'out'
    command = [sys.executable, '-m', 'motion_detect_ros', 'replay', str(bag), '-o', str(out)]
    process = subprocess.Popen(command, env={**os.environ}, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)
    part = out / 'detections.mcap.part'
    try:
        deadline = time.monotonic() + TIMEOUT_S
        while not (part.exists() and part.stat().st_size > 4000):
            assert time.monotonic() < deadline and process.poll() is None
            time.sleep(0.01)
    finally:
        process.send_signal(signal.SIGKILL)
        process.wait()
    with BagReader(part) as reader:
        stamps = [message.log_stamp_ns for message in reader.messages(['/detections'])]
        assert 'cut off' in str(reader.damaged)
    assert len(stamps) > 5
    assert stamps == regular(len(stamps))
    shown('replay is killed (-9)', 'what it had done up to a few frames before is readable', f'{len(stamps)} frames')
