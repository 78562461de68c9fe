"""A second run does what the first did not finish, and nothing else's results are touched."""

from __future__ import annotations

import json
import os
import shutil
import signal
import subprocess
import sys
import time
from pathlib import Path

import cv2
import numpy as np
import pytest
from batch_flights import PATIENCE_S, trap, write_flight

from motion_detect_ros.__main__ import main
from motion_detect_ros.report import embedding
from motion_detect_ros.results.files import OUTPUT_NAMES
from motion_detect_ros.sources.bags import BagReader, BagWriter

pytestmark = pytest.mark.messages


def write_bag(
    path: Path, frames: int = 4, topic: str = '/image_raw', size: tuple[int, int] = (96, 128),
) -> Path:
    texture = np.random.default_rng(0).integers(0, 256, size, np.uint8)
    with BagWriter(path) as writer:
        for index in range(frames):
            writer.write_image(np.roll(texture, index, axis=1), index * 10**8, topic)
    return path


def two_topics(path: Path) -> Path:
    with BagWriter(path) as writer:
        for index in range(4):
            for topic, column in (('/image_raw', 0), ('/other', 9)):
                texture = np.random.default_rng(column).integers(0, 256, (96, 128), np.uint8)
                writer.write_image(np.roll(texture, index, axis=1), index * 10**8, topic)
    return path


def contents(folder: Path) -> dict[str, bytes]:
    return {path.name: path.read_bytes() for path in folder.iterdir()}


def said(capsys: pytest.CaptureFixture[str]) -> str:
    captured = capsys.readouterr()
    return captured.out + captured.err


def test_what_is_finished_is_left_alone_and_said(tmp_path: Path, capsys: pytest.CaptureFixture[str]):
    words = ['replay', str(write_bag(tmp_path / 'a.mcap')), '-o', str(tmp_path / 'out')]
    assert main(words) == 0
    before, first = contents(tmp_path / 'out'), said(capsys)
    assert main(words) == 0
    assert contents(tmp_path / 'out') == before, 'times.csv too, which no two runs have in common'
    assert said(capsys) == f'{first.strip()} (finished earlier)\n'
    assert main([*words, '--force']) == 0
    assert contents(tmp_path / 'out')['times.csv'] != before['times.csv']
    assert contents(tmp_path / 'out')['detections.mcap'] == before['detections.mcap']


def test_a_report_that_is_missing_is_made_of_what_is_finished(tmp_path: Path, capsys: pytest.CaptureFixture[str]):
    for library in embedding.NEEDED:
        pytest.importorskip(library, reason=f'{library} is not installed (extra "report")')
    words = ['replay', str(write_bag(tmp_path / 'a.mcap')), '-o', str(tmp_path / 'out')]
    assert main([*words, '--no-report']) == 0
    before = contents(tmp_path / 'out')
    said(capsys)
    assert main([*words, '--no-report']) == 0
    assert contents(tmp_path / 'out') == before
    first = said(capsys)
    assert main(words) == 0
    after = contents(tmp_path / 'out')
    assert after.pop('report.html').startswith(b'<!')
    assert (after, said(capsys)) == (before, f'{first.strip()}; report.html made now\n')
    assert main(words) == 0
    assert said(capsys) == first, 'once'


def test_an_input_that_came_later_is_done(tmp_path: Path, capsys: pytest.CaptureFixture[str]):
    write_bag(tmp_path / 'bags' / 'a.mcap')
    words = ['replay', str(tmp_path / 'bags'), '-o', str(tmp_path / 'out')]
    assert main(words) == 0
    write_bag(tmp_path / 'bags' / 'b.mcap')
    said(capsys)
    assert main(words) == 0
    assert '2 inputs: 1 done, 1 finished earlier\n' in said(capsys)
    assert sorted(path.name for path in (tmp_path / 'out').iterdir()) == ['a', 'b', 'replay.json']


def test_inputs_keep_their_folders_when_one_of_the_same_name_comes_before(
    tmp_path: Path, capsys: pytest.CaptureFixture[str],
):
    write_bag(tmp_path / 'bags' / 'monday' / 'flight.mcap')
    words = ['replay', str(tmp_path / 'bags'), '-o', str(tmp_path / 'out'), '--no-report']
    assert main(words) == 0
    write_bag(tmp_path / 'bags' / 'friday' / 'flight.mcap', 6)
    said(capsys)
    assert main(words) == 0
    assert '2 inputs: 1 done, 1 finished earlier\n' in said(capsys)
    assert main(words) == 0
    assert '2 inputs: 2 finished earlier\n' in said(capsys)
    frames = {folder: json.loads((tmp_path / 'out' / folder / 'summary.json').read_text())['frames']
              for folder in ('flight', 'flight-2')}
    assert frames == {'flight': 4, 'flight-2': 6}


def test_an_input_keeps_its_folder_when_one_before_it_is_removed(tmp_path: Path, capsys: pytest.CaptureFixture[str]):
    first, second = (str(write_bag(tmp_path / day / 'a.mcap', frames)) for day, frames in (('d1', 4), ('d2', 6)))
    words, out = ['-o', str(tmp_path / 'out'), '--no-report'], tmp_path / 'out'
    assert main(['replay', first, second, *words]) == 0
    shutil.rmtree(out / 'a')
    said(capsys)
    assert main(['replay', str(tmp_path / 'd2*'), *words]) == 0
    assert said(capsys).startswith(f'{out}/a-2: 6 frames')
    assert not (out / 'a').exists()
    assert main(['replay', second, first, *words]) == 0
    assert '2 inputs: 1 done, 1 finished earlier\n' in said(capsys)
    assert [json.loads((out / name / 'summary.json').read_text())['frames'] for name in ('a', 'a-2')] == [4, 6]


def test_dots_in_the_names_of_folders_are_no_suffixes(tmp_path: Path):
    for day in (1, 2):
        folder = tmp_path / 'flights' / f'2024.05.0{day}'
        folder.mkdir(parents=True)
        for index in range(12):
            cv2.imwrite(str(folder / f'{index}.png'), np.roll(np.eye(64, dtype=np.uint8) * 200, index, axis=day - 1))
    (tmp_path / 'truth').mkdir()
    for name in ('2024.05.01', '2024.05.02'):
        (tmp_path / 'truth' / f'{name}.csv').write_text('frame,id,x,y,w,h,moving\n11,1,2,2,20,20,1\n')
    out = tmp_path / 'out'
    assert main(['replay', str(tmp_path / 'flights'), '-o', str(out), '--no-report']) == 0
    assert sorted(path.name for path in out.iterdir()) == ['2024.05.01', '2024.05.02', 'replay.json']
    (out / '2024.05.01').rename(out / 'first')
    assert main(['evaluate', str(out), '--truth', str(tmp_path / 'truth'), '--bootstrap', '0']) == 0


def test_an_input_that_has_changed_is_done_anew(tmp_path: Path, capsys: pytest.CaptureFixture[str]):
    bag, out = write_bag(tmp_path / 'a.mcap'), tmp_path / 'out'
    words = ['replay', str(bag), '-o', str(out), '--no-report']
    assert main(words) == 0
    write_bag(bag, 6)
    said(capsys)
    assert main(words) == 0
    assert said(capsys).startswith(f'{out}: the input has changed, done anew\n{out}: 6 frames')
    assert main(words) == 0
    assert '(finished earlier)' in said(capsys)


def test_a_replay_that_was_killed_is_done_anew(tmp_path: Path, capsys: pytest.CaptureFixture[str]):
    bag, out = write_bag(tmp_path / 'a.mcap', 40), tmp_path / 'out'
    words = ['replay', str(bag), '-o', str(out), '--no-report']
    dead = subprocess.run([sys.executable, '-m', 'motion_detect_ros', *words], capture_output=True, check=False,
                          timeout=PATIENCE_S, env=trap(tmp_path, out / 'frames.csv.part', 1))
    assert dead.returncode == -signal.SIGKILL
    assert json.loads((out / 'summary.json').read_text())['complete'] is False
    assert main(words) == 0
    assert said(capsys).startswith(f'{out}: incomplete, done anew\n{out}: 40 frames')
    assert sorted(contents(out)) == sorted(OUTPUT_NAMES)


def test_an_interrupted_replay_of_many_closes_its_files_and_goes_on_later(tmp_path: Path):
    """SIGINT to the whole group, as a terminal sends it. Of fewer than 500 pictures no progress is told."""
    write_bag(tmp_path / 'bags' / 'a.mcap')
    for name in 'bc':
        write_bag(tmp_path / 'bags' / f'{name}.mcap', 490, size=(300, 400))
    out = tmp_path / 'out'
    words = ['replay', str(tmp_path / 'bags'), '-o', str(out), '--workers', '2', '--no-report']
    running = subprocess.Popen([sys.executable, '-m', 'motion_detect_ros', *words], stdout=subprocess.PIPE,
                               stderr=subprocess.PIPE, text=True, start_new_session=True)
    deadline = time.monotonic() + PATIENCE_S
    for part in (out / name / 'detections.mcap.part' for name in 'bc'):
        while not part.exists() or part.stat().st_size < 3000:
            assert time.monotonic() < deadline and running.poll() is None
            time.sleep(0.01)
    os.killpg(running.pid, signal.SIGINT)
    stdout, stderr = running.communicate(timeout=PATIENCE_S)
    assert running.returncode == 3
    assert stderr == 'interrupted; what was written so far is kept in the .part files\n'
    assert stdout.startswith(f'{out}/a: 4 frames')
    entries = json.loads((out / 'replay.json').read_text())['inputs']
    assert [entry['state'] for entry in entries] == ['done', 'partial', 'partial']
    assert entries[1]['line'] == f'{out}/b: interrupted'
    for name in 'bc':
        summary = json.loads((out / name / 'summary.json').read_text())
        assert not summary['complete'] and summary['frames'] < 490
        with BagReader(out / name / 'detections.mcap.part') as reader:
            written = len([*reader.messages(['/detections'])])
            assert written - summary['frames'] in (0, 1), 'one may have been written, not yet counted'
            assert reader.damaged is None, 'closed as it should be'
    for name in 'bc':
        write_bag(tmp_path / 'bags' / f'{name}.mcap')
    assert main(['replay', str(tmp_path / 'bags'), '-o', str(out), '--no-report']) == 0
    states = [entry['state'] for entry in json.loads((out / 'replay.json').read_text())['inputs']]
    assert states == ['finished earlier', 'done', 'done']


#: Imported by every Python before all else: a process of the batch takes long to start.
SLOW_START = """
import os, pathlib, sys, time
if '--multiprocessing-fork' in sys.orig_argv:
    pathlib.Path(os.environ['STARTED']).touch()
    time.sleep(2.0)
"""


def test_an_interrupt_while_processes_start_is_one_line(tmp_path: Path):
    for name in 'ab':
        write_bag(tmp_path / 'bags' / f'{name}.mcap')
    (tmp_path / 'sitecustomize.py').write_text(SLOW_START)
    started = tmp_path / 'started'
    words = ['replay', str(tmp_path / 'bags'), '-o', str(tmp_path / 'out'), '--workers', '2', '--no-report']
    running = subprocess.Popen(
        [sys.executable, '-m', 'motion_detect_ros', *words], stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True,
        start_new_session=True, env={**os.environ, 'PYTHONPATH': str(tmp_path), 'STARTED': str(started)})
    deadline = time.monotonic() + PATIENCE_S
    while not started.exists():
        assert time.monotonic() < deadline and running.poll() is None
        time.sleep(0.01)
    os.killpg(running.pid, signal.SIGINT)
    _, stderr = running.communicate(timeout=PATIENCE_S)
    assert stderr == 'interrupted; what was written so far is kept in the .part files\n'


@pytest.mark.parametrize(('words', 'difference'), [
    (['--every', '2'], 'every not given, now 2'),
    (['--start', '0.1'], 'start_s not given, now 0.1'),
    (['--duration', '1'], 'duration_s not given, now 1.0'),
    (['--topic', 'other'], 'topic image_raw, now other'),
    (['--preset', 'visdrone'], 'ego_motion.'),
])
def test_results_of_other_settings_are_refused(
    words: list[str], difference: str, tmp_path: Path, capsys: pytest.CaptureFixture[str],
):
    bag, out = two_topics(tmp_path / 'a.mcap'), tmp_path / 'out'
    first = ['replay', str(bag), '-o', str(out), '--topic', 'image_raw']
    assert main(first) == 0
    before = contents(out)
    capsys.readouterr()
    assert main([*first, *words]) == 2
    message = capsys.readouterr().err
    assert message.startswith(f'error: {out}: holds a result of something else (')
    assert message.endswith('); --force overwrites it\n')
    assert message.count('\n') == 1
    assert difference in message or words[0] == '--preset'
    assert contents(out) == before


@pytest.mark.parametrize(('first', 'then'), [
    ([], ['--start', '0', '--every', '1', '--topic', 'image_raw']),
    (['--start', '0', '--every', '1', '--topic', 'image_raw'], []),
    (['--topic', 'image_raw'], ['--topic', '/image_raw']),
])
def test_options_that_change_nothing_find_the_same_result(
    first: list[str], then: list[str], tmp_path: Path, capsys: pytest.CaptureFixture[str],
):
    words = ['replay', str(write_bag(tmp_path / 'a.mcap')), '-o', str(tmp_path / 'out'), '--no-report']
    assert main([*words, *first]) == 0
    before = contents(tmp_path / 'out')
    said(capsys)
    assert main([*words, *then]) == 0
    assert '(finished earlier)' in said(capsys)
    assert contents(tmp_path / 'out') == before


@pytest.mark.parametrize('finished', [True, False])
def test_results_of_another_input_or_version_are_refused(
    finished: bool, tmp_path: Path, capsys: pytest.CaptureFixture[str],
):
    bag, other, out = write_bag(tmp_path / 'a.mcap'), write_bag(tmp_path / 'b.mcap'), tmp_path / 'out'
    assert main(['replay', str(bag), '-o', str(out)]) == 0
    summary = json.loads((out / 'summary.json').read_text())
    (out / 'summary.json').write_text(json.dumps({**summary, 'complete': finished}))
    assert main(['replay', str(other), '-o', str(out)]) == 2
    assert f'(input {bag}, now {other}); --force' in capsys.readouterr().err
    (out / 'summary.json').write_text(json.dumps({**summary, 'complete': finished, 'version': '0.0.1'}))
    assert main(['replay', str(bag), '-o', str(out)]) == 2
    assert f'(version 0.0.1, now {summary["version"]}); --force' in capsys.readouterr().err
    assert main(['replay', str(other), '-o', str(out), '--force']) == 0


def test_an_unreadable_input_takes_no_earlier_result_with_it(tmp_path: Path):
    """Even with --force: what is there is worth more than nothing."""
    bag, out = write_bag(tmp_path / 'a.mcap'), tmp_path / 'out'
    assert main(['replay', str(bag), '-o', str(out)]) == 0
    before = contents(out)
    bag.unlink()
    assert main(['replay', str(bag), '-o', str(out), '--force']) == 2
    assert contents(out) == before


def test_windows_on_the_command_line(tmp_path: Path):
    bag, out = write_bag(tmp_path / 'a.mcap', 20), tmp_path / 'out'
    words = ['replay', str(bag), '-o', str(out), '--start', '0.5', '--duration', '1', '--every', '3']
    assert main(words) == 0
    summary = json.loads((out / 'summary.json').read_text())
    assert (summary['start_s'], summary['duration_s'], summary['every'], summary['frames']) == (0.5, 1.0, 3, 4)
    rows = (out / 'frames.csv').read_text().splitlines()[1:]
    assert [row.split(',')[:2] for row in rows] == [[str(n), str(n * 10**8)] for n in (5, 8, 11, 14)]


def test_nothing_in_the_window_is_said(tmp_path: Path, capsys: pytest.CaptureFixture[str]):
    words = ['replay', str(write_bag(tmp_path / 'a.mcap')), '-o', str(tmp_path / 'out'), '--start', '9']
    assert main(words) == 1
    assert '0 frames' in said(capsys).partition('; nothing from 9 s')[0]


def test_results_inside_of_the_input_do_not_change_it(tmp_path: Path, capsys: pytest.CaptureFixture[str]):
    frames = tmp_path / 'frames'
    frames.mkdir()
    for index in range(4):
        cv2.imwrite(str(frames / f'{index}.png'), np.full((48, 64), 20 * index, np.uint8))
    words = ['replay', str(frames), '-o', str(frames / 'out'), '--no-report']
    assert main(words) == 0
    said(capsys)
    assert main(words) == 0
    assert '(finished earlier)' in said(capsys)


@pytest.mark.parametrize('given', ['option', 'preset'])
def test_rectified_images_are_another_result(given: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]):
    bag, out, preset = write_flight(tmp_path / 'a.mcap', frames=3), tmp_path / 'out', tmp_path / 'mine.yaml'
    preset.write_text('/**: {ros__parameters: {rectified: true}}\n')
    words = ['replay', str(bag), '-o', str(out), '--no-report']
    rectified = [*words, *(['--rectified'] if given == 'option' else ['--preset', str(preset)])]
    assert main(words) == 0
    capsys.readouterr()
    assert main(rectified) == 2
    assert 'holds a result of something else (rectified False, now True)' in capsys.readouterr().err
    assert main([*rectified, '--force']) == 0
    assert json.loads((out / 'summary.json').read_text())['rectified'] is True
    assert main(rectified) == 0
    assert capsys.readouterr().out.splitlines()[-1].endswith('(finished earlier)')


def test_a_result_without_frames_stands_in_nobodys_way(tmp_path: Path, capsys: pytest.CaptureFixture[str]):
    """A window beyond the end by mistake, then the right one."""
    bag, out = write_flight(tmp_path / 'a.mcap', frames=3), tmp_path / 'out'
    words = ['replay', str(bag), '-o', str(out), '--no-report']
    assert main([*words, '--start', '100']) == 1
    assert main(words) == 0, capsys.readouterr().err
    assert json.loads((out / 'summary.json').read_text())['frames'] == 3
    assert main([*words, '--start', '100']) == 2
    assert 'holds a result of something else (start_s' in capsys.readouterr().err
