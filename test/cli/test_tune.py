"""tune as a command, on a made flight: a textured square over textured ground, seen by a panning camera."""

from __future__ import annotations

import json
import os
import platform
import shutil
import sys
from pathlib import Path

import cv2
import numpy as np
import pytest
from test_pipeline import SIDE, box_of, scene

import motion_detect_ros
from motion_detect_ros.__main__ import main
from motion_detect_ros.core.threads import limited, threads
from motion_detect_ros.presets import load_preset, read_parameters
from motion_detect_ros.results.ownership import owned
from motion_detect_ros.tuning.objective import TruthObjective
from motion_detect_ros.tuning.recording import Recording

FRAMES = 40
#: A floor under which nothing is seen to move: the square moves 7 px a frame.
BAD = ('/**:\n  ros__parameters:\n    background:\n      noise_floor_px: 5.0\n    objects:\n      min_side_px: 7.0\n'
       '    queue_size: 12\n    image_transport: compressed\n')


@pytest.fixture(scope='module')
def flight(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp('tune')
    (folder / 'flight').mkdir()
    rows = []
    for frame in range(FRAMES):
        cv2.imwrite(str(folder / 'flight' / f'{frame:06d}.png'), scene(frame))
        left, top = box_of(frame)
        rows.append(f'{frame},1,{left},{top},{SIDE},{SIDE},1\n')
    (folder / 'flight.csv').write_text('frame,id,x,y,w,h,moving\n' + ''.join(rows))
    (folder / 'bad.yaml').write_text(BAD)
    return folder


def tune(flight: Path, out: Path, *words: str) -> int:
    pytest.importorskip('optuna', reason="pip install 'motion_detect_ros[tune]'")
    return main(['tune', str(flight / 'flight'), '-o', str(out), '--preset', str(flight / 'bad.yaml'), *words])


def test_a_bad_start_is_improved_on_what_was_held_out(
    flight: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str],
) -> None:
    words = ('--truth', str(flight / 'flight.csv'), '--settings', 'background.noise_floor_px', '--trials')
    assert tune(flight, tmp_path, *words, '2') == 0
    lines = capsys.readouterr().out.splitlines()
    assert lines[0].startswith(f'{tmp_path}: gain of +')
    assert lines[1].startswith('caution: 10 frames are few: with under 125, blocks are cut short')
    report = json.loads((tmp_path / 'tune.json').read_text())
    assert report['held_out']['start_f1'] == 0.0
    assert report['held_out']['candidate_f1'] > 0.9
    assert report['held_out']['interval'][0] > 0
    tuned = load_preset(tmp_path / 'preset.yaml')
    assert tuned.background.noise_floor_px == report['candidate']['background.noise_floor_px'] < 1
    assert tuned.objects.min_side_px == 7.0, 'what was not searched stays'
    again = TruthObjective('moving', 0.3).measure(Recording(str(flight / 'flight'), flight / 'flight.csv'), tuned)
    assert again[:, 0].sum() > 0.9 * again[:, 2].sum()
    page = (tmp_path / 'tune.md').read_text()
    assert 'Recommended: the tuned settings' in page
    assert 'every third of 6 blocks of each recording (10 frames)' in page
    assert tune(flight, tmp_path, *words, '3') == 0
    assert len(json.loads((tmp_path / 'tune.json').read_text())['trials']) == 3, 'two of before, one more'


def test_without_truth_the_flight_backwards_tells(flight: Path, tmp_path: Path) -> None:
    assert tune(flight, tmp_path, '--settings', 'background.noise_floor_px', '--trials', '1', '--seed', '5') == 0
    assert 'agreement with the flight backwards' in (tmp_path / 'tune.md').read_text()
    assert load_preset(tmp_path / 'preset.yaml').background.noise_floor_px < 1


def test_no_password_of_the_start_is_handed_on(
    flight: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str],
) -> None:
    start = tmp_path / 'own.yaml'
    start.write_text(f'{BAD}camera:\n  ros__parameters:\n    frame_id: a\n'
                     '    source: rtsp://user:hunter2@10.0.0.7/live\n')
    assert tune(flight, tmp_path / 'out', '--preset', str(start), '--truth', str(flight / 'flight.csv'), '--settings',
                'background.noise_floor_px', '--trials', '1') in {0, 1}
    assert f'{start}: source holds credentials and is left out of the presets' in capsys.readouterr().err
    for name in ('preset.yaml', 'candidate.yaml'):
        text = (tmp_path / 'out' / name).read_text()
        assert 'hunter2' not in text and 'source' not in text
        assert 'frame_id: a' in text and 'queue_size: 12' in text


def test_trials_worse_than_the_start_are_no_news(
    flight: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str],
) -> None:
    asked = []

    def worse_and_worse(*_: object) -> np.ndarray:
        asked.append(0)
        return np.tile(np.array([max(0, 60 - 10 * len(asked)), 0, 60]), (120, 1))

    monkeypatch.setattr(TruthObjective, 'measure', worse_and_worse)
    assert tune(flight, tmp_path, '--truth', str(flight / 'flight.csv'), '--trials', '3') == 1
    assert 'on what is searched' not in capsys.readouterr().err
    assert len(asked) > 3


def test_where_there_is_nothing_but_luck_the_start_stays(
    flight: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str],
) -> None:
    rng = np.random.default_rng(4)

    def luck(*_: object) -> np.ndarray:
        return np.stack([rng.binomial(10, 0.5, 120), np.zeros(120), np.full(120, 10)], axis=-1).astype(np.int64)

    monkeypatch.setattr(TruthObjective, 'measure', luck)
    assert tune(flight, tmp_path, '--truth', str(flight / 'flight.csv'), '--trials', '6') == 1
    lines = capsys.readouterr().out.splitlines()
    assert 'no gain shown' in lines[0]
    assert lines[-1].startswith('recommended: the start, unchanged')
    report = json.loads((tmp_path / 'tune.json').read_text())
    assert report['searched_gain'] > 0 and not report['gain_shown']
    assert load_preset(tmp_path / 'preset.yaml') == load_preset(flight / 'bad.yaml')
    assert load_preset(tmp_path / 'candidate.yaml') != load_preset(flight / 'bad.yaml')
    assert read_parameters(tmp_path / 'preset.yaml') == read_parameters(flight / 'bad.yaml'), 'those of the nodes too'
    assert {'queue_size', 'image_transport'} <= set(read_parameters(tmp_path / 'candidate.yaml'))


def test_trials_of_other_data_are_not_gone_on_with(
    flight: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str],
) -> None:
    shutil.copytree(flight, tmp_path / 'data')
    here, labels = tmp_path / 'data', tmp_path / 'data' / 'flight.csv'
    words = ('--settings', 'background.noise_floor_px', '--truth', str(labels), '--trials', '1')
    assert tune(here, here / 'flight' / 'tuned', *words) in (0, 1)
    assert tune(here, here / 'flight' / 'tuned', *words) in (0, 1), 'what it wrote itself changes no input'
    labels.write_text(labels.read_text().replace('5,1,', '5,2,', 1))
    with (here / 'flight' / '000000.png').open('ab') as picture:
        picture.write(b'0')
    monkeypatch.setattr(motion_detect_ros, '__version__', '0.0.1')
    assert tune(here, here / 'flight' / 'tuned', *words) == 2
    assert 'holds the trials of another search (input_bytes, truth_contents, version differ)' in capsys.readouterr().err
    assert tune(here, here / 'flight' / 'tuned', *words, '--force') in (0, 1)


def test_inputs_are_those_that_replay_takes(flight: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """A pattern, and a tree in which the outputs are."""
    pytest.importorskip('optuna', reason="pip install 'motion_detect_ros[tune]'")
    for name in ('one', 'two'):
        shutil.copytree(flight / 'flight', tmp_path / 'tree' / 'day' / name)
    words = ['-o', str(tmp_path / 'tree' / 'tuned'), '--preset', str(flight / 'bad.yaml'), '--trials', '1']
    (tmp_path / 'one.csv').write_bytes((flight / 'flight.csv').read_bytes())
    for inputs in ('tree/day/*', 'tree', 'tree'):
        assert main(['tune', str(tmp_path / inputs), '--truth', str(tmp_path), *words]) == 2
        assert capsys.readouterr().err == 'error: --truth: expected truth of every input, found none of two\n'
    (tmp_path / 'two.csv').write_bytes((flight / 'flight.csv').read_bytes())
    for _ in range(2):
        assert main(['tune', str(tmp_path / 'tree'), '--truth', str(tmp_path), *words]) in (0, 1)
    assert f"- inputs: {tmp_path / 'tree'}" in (tmp_path / 'tree' / 'tuned' / 'tune.md').read_text()
    assert main(['tune', str(tmp_path / 'tree' / 'day' / 'one'), '-o', str(tmp_path / 'tree' / 'day' / 'one')]) == 2
    assert 'expected another folder for the outputs than the input itself' in capsys.readouterr().err


def test_settings_of_the_user_are_not_overwritten(
    flight: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str],
) -> None:
    mine = tmp_path / 'preset.yaml'
    mine.write_text(BAD)
    assert tune(flight, tmp_path, '--trials', '1') == 2
    assert capsys.readouterr().err == f'error: {mine}: exists and is not of an earlier search; --force overwrites it\n'
    for force in ([], ['--force']):
        assert tune(flight, tmp_path, '--trials', '1', '--preset', str(mine), *force) == 2
        assert capsys.readouterr().err == (
            f'error: {mine}: expected a start that no output replaces; choose another --output\n')
    assert mine.read_text() == BAD
    assert [*tmp_path.iterdir()] == [mine]
    assert tune(flight, tmp_path, '--trials', '1', '--force') in (0, 1)


def test_a_folder_that_another_search_writes(
    flight: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str],
) -> None:
    """Its trials are neither ended nor forgotten by a second one."""
    with owned(tmp_path):
        for force in ([], ['--force']):
            assert tune(flight, tmp_path, '--trials', '1', *force) == 2
            who = f'process {os.getpid()} on {platform.node()}'
            assert capsys.readouterr().err == f'error: {tmp_path}: is being written by another process ({who})\n'
        assert [each.name for each in tmp_path.iterdir()] == ['.writing']
    assert tune(flight, tmp_path, '--trials', '1') in (0, 1)
    assert not (tmp_path / '.writing').exists()


def test_ctrl_c_says_that_the_trials_are_kept(
    flight: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str],
) -> None:
    measure, calls = TruthObjective.measure, []

    def interrupted(*words: object) -> np.ndarray:
        calls.append(words)
        if len(calls) == 3:
            raise KeyboardInterrupt
        return measure(*words)  # type: ignore[arg-type]

    monkeypatch.setattr(TruthObjective, 'measure', interrupted)
    words = ('--truth', str(flight / 'flight.csv'), '--trials', '5', '--settings', 'background.noise_floor_px')
    assert tune(flight, tmp_path, *words) == 3
    assert capsys.readouterr().err.splitlines()[-1] == (
        f'interrupted; the trials that ended are kept in {tmp_path}/trials.sqlite3, the same command goes on with them')


def test_threads_are_those_of_the_preset(flight: Path, tmp_path: Path) -> None:
    (tmp_path / 'one.yaml').write_text('/**: {ros__parameters: {load: {threads: 1}}}')
    with limited(2):
        tune(flight, tmp_path / 'out', '--preset', str(tmp_path / 'one.yaml'), '--trials', '1')
        assert threads() == 1


def test_angular_rates_are_not_tuned_with(flight: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    (tmp_path / 'imu.yaml').write_text('/**: {ros__parameters: {imu: {use: true}}}')
    assert tune(flight, tmp_path / 'out', '--preset', str(tmp_path / 'imu.yaml'), '--trials', '1') == 2
    assert capsys.readouterr().err == (
        f'error: {tmp_path}/imu.yaml: imu.use: expected false, as tune uses the pictures only, got true\n')
    assert not (tmp_path / 'out').exists()


@pytest.mark.parametrize(('words', 'complaint'), [
    (['--trials', '0'], '--trials: expected 1 or more, got 0'),
    (['--iou', '0'], '--iou: expected a number over 0 up to 1, got 0'),
    (['--time', '0'], '--time: expected a number over 0, got 0'),
    (['--settings', 'tracks.nothing'], "unknown setting 'tracks.nothing'; searched by default: background.noise_floor"),
    (['--truth', 'a.csv', 'b.csv'], '--truth: expected a folder, or a file for each of the 1 clips (flight), got 2'),
])
def test_wrong_use(
    flight: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str], words: list[str], complaint: str,
) -> None:
    assert main(['tune', str(flight / 'flight'), '-o', str(tmp_path), *words]) == 2
    assert capsys.readouterr().err.startswith(f'error: {complaint}')


def test_without_optuna(
    flight: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str],
) -> None:
    monkeypatch.setitem(sys.modules, 'optuna', None)
    assert main(['tune', str(flight / 'flight'), '-o', str(tmp_path)]) == 2
    assert capsys.readouterr().err.endswith(': pip install optuna\n')
