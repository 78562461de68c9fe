"""The demo: its table by counts worked out by hand, its files by other readers, and the whole of it once."""

from __future__ import annotations

import subprocess
import sys
from dataclasses import replace
from pathlib import Path

import cv2
import numpy as np
import pytest
from mcap.reader import make_reader

from motion_detect_ros.cli.demo import exit_code, real_time_factor
from motion_detect_ros.cli.demo_files import begin
from motion_detect_ros.cli.demo_table import Run, largest_difference, score_rows, table, without_small
from motion_detect_ros.core.errors import SourceError
from motion_detect_ros.core.types import TRUTH_DTYPE, RecordArray, empty_detections
from motion_detect_ros.results.metrics import boxes_of

START_NS, PERIOD_NS = 1_700_000_000_000_000_000, 50_000_000
FRAMES = 20


def detections(*boxes: tuple[float, float, float, float]) -> RecordArray:
    """Records whose top left corner, width and height are ``boxes``; ids from 1."""
    records = empty_detections(len(boxes))
    for ident, (record, (x, y, w, h)) in enumerate(zip(records, boxes, strict=True), start=1):
        record['u'], record['v'], record['width'], record['height'] = x + w / 2, y + h / 2, w, h
        record['id'] = ident
    return records


def a_run(*records: RecordArray | None, times_ms: tuple[float, ...] = (5.0,)) -> Run:
    answered = {frame: record for frame, record in enumerate(records) if record is not None}
    return Run(tuple(range(len(records))), answered, len(answered), times_ms)


def two_movers() -> RecordArray:
    """20 frames: a car of 60 x 40 and a walker of 8 x 16, both moving."""
    return np.array([row for frame in range(FRAMES) for row in (
        (frame, 1, 100, 100, 60, 40, 1), (frame, 2, 400, 300, 8, 16, 1))], TRUTH_DTYPE)


class TestTable:
    def test_scores(self) -> None:
        """The car is found in every frame with IoU 0.5 * 60 / 60 = 0.5 exactly, the walker never, and one box is
        false: 10 of 20 counted boxes are hits. Against the car alone: recall 1.
        """
        run = a_run(*[detections((100, 100, 60, 20), (700, 400, 50, 50))] * FRAMES)
        rows = {(row.what, row.iou): row.score for row in score_rows(two_movers(), run)}
        assert len(rows) == 4
        for iou in (0.3, 0.5):
            every, large = rows['all', iou], rows['32 x 32 px and larger', iou]
            assert (every.precision, every.recall, every.f1) == (0.5, 0.5, 0.5)
            assert (large.precision, large.recall, large.f1) == (0.5, 1.0, pytest.approx(2 / 3))
            assert (every.wanted, large.wanted, every.frames, every.false_per_frame) == (20, 10, 10, 1.0)

    def test_half_a_box_is_no_hit_at_half(self) -> None:
        run = a_run(*[detections((100, 100, 60, 19))] * FRAMES)  # IoU 19 / 40
        scores = {row.iou: row.score for row in score_rows(two_movers(), run) if row.what == 'all'}
        assert (scores[0.3].recall, scores[0.5].recall) == (0.5, 0.0)

    def test_small_is_under_32_by_32(self) -> None:
        truth = np.array([(0, 1, 0, 0, 32, 32, 1), (0, 2, 0, 0, 31, 33, 1), (0, 3, 0, 0, 8, 8, 0)], TRUTH_DTYPE)
        assert without_small(truth)['moving'].tolist() == [1, -1, -1]
        assert truth['moving'].tolist() == [1, 1, 0], 'a copy'

    def test_lines(self) -> None:
        answer = detections((100, 100, 60, 40), (700, 400, 50, 50))
        run = replace(a_run(*[answer] * 19, None), times_ms=(10.0, 20.0, float('nan'), 30.0))
        lines = '\n'.join(table(two_movers(), run, a_run(*[answer] * 20)))
        for words in ('images in 20', 'detections messages out 19', 'images dropped 1', 'boxes, objects 38, 2',
                      'image to detections p50 20.0 ms, p95 29.0 ms, 3 images', 'largest difference to it inf px',
                      'all 0.3 0.500 0.450 0.474 0.90 20'):
            assert words in ' '.join(lines.split()), lines

    def test_images_that_the_settings_leave_out_are_no_misses(self) -> None:
        """Every second image is asked for and the car found in all of these; without that, recall is half of it."""
        answers = [detections((100, 100, 60, 40)) if frame % 2 == 0 else None for frame in range(FRAMES)]
        run = replace(a_run(*answers), left_out=frozenset(range(1, FRAMES, 2)))
        score = next(row.score for row in score_rows(two_movers(), run) if row.what != 'all')
        assert (score.recall, score.frames, run.unanswered) == (1.0, 5, 0)
        assert next(row.score for row in score_rows(two_movers(), a_run(*answers)) if row.what != 'all').recall == 0.5

    def test_largest_difference(self) -> None:
        one = a_run(detections((10, 10, 40, 40), (90, 90, 40, 40)))
        assert largest_difference(one, one) == 0
        assert largest_difference(one, a_run(detections((10, 10, 40, 40), (90, 91.5, 40, 40)))) == 1.5
        assert largest_difference(one, a_run(detections((10, 10, 40, 40), (90, 90, 40, 40))[::-1])) == 0, 'any order'
        assert largest_difference(one, a_run(detections((10, 10, 40, 40)))) == float('inf'), 'an object less'
        assert largest_difference(one, a_run(None)) == float('inf'), 'no answer'

    def test_boxes_of(self) -> None:
        assert boxes_of(detections((10, 20, 30, 40))).tolist() == [[10, 20, 30, 40]]


def test_exit_code_says_whether_every_image_was_answered() -> None:
    nothing_found = empty_detections()
    assert exit_code(a_run(nothing_found, nothing_found)) == 0
    assert exit_code(a_run(nothing_found, None)) == 3
    assert exit_code(a_run(None, None)) == 1


def test_real_time_factor() -> None:
    """25 ms an image are 40 images a second, twice what a 20 Hz camera gives."""
    assert real_time_factor(a_run(None, times_ms=(24.0, 25.0, 90.0)), 20.0) == pytest.approx(2.0)


def demo(*words: str | Path) -> subprocess.CompletedProcess[str]:
    return subprocess.run([sys.executable, '-m', 'motion_detect_ros', 'demo', *map(str, words)],
                          capture_output=True, text=True, timeout=600, check=False)


@pytest.mark.parametrize(('words', 'message'), [
    (('--frames', '3'), 'error: --frames: expected 20 or more, got 3'),
    (('--rate', '0'), 'error: --rate: expected a number over 0, got 0'),
    (('--preset', 'moon', '--offline'),
     'error: moon: expected a preset (default, kitti, report, visdrone) or a YAML file'),
    (('-o', '/proc/demo'), 'error: /proc/demo: cannot be made a folder for the outputs: No such file or directory'),
])
def test_wrong_use_is_one_line(words: tuple[str, ...], message: str, tmp_path: Path) -> None:
    output = () if '-o' in words else ('-o', tmp_path)
    done = demo('--frames', '20', *output, *words)
    assert (done.returncode, done.stderr.strip().splitlines()[-1]) == (2, message)
    assert not any(tmp_path.iterdir()), 'nothing is drawn before the words are checked'


def stamps_in(bag: Path, topic: str) -> list[int]:
    with bag.open('rb') as stream:
        return [message.log_time for _, _, message in make_reader(stream).iter_messages(topics=[topic])]


def check_files(folder: Path) -> None:
    """What the demo left behind, read by other libraries; stamps follow from 20 Hz."""
    expected = [START_NS + frame * PERIOD_NS for frame in range(FRAMES)]
    assert stamps_in(folder / 'flight.mcap', '/image_raw') == expected
    assert stamps_in(folder / 'detections.mcap', '/detections') == expected
    assert int(cv2.VideoCapture(str(folder / 'demo.mp4')).get(cv2.CAP_PROP_FRAME_COUNT)) == FRAMES
    sheet = cv2.imread(str(folder / 'contact_sheet.png'))
    assert sheet is not None and sheet.std() > 20, 'something is on it'
    assert not [path for path in folder.iterdir() if '.part' in path.name]


def test_offline(tmp_path: Path) -> None:
    done = demo('--offline', '--frames', str(FRAMES), '-o', tmp_path)
    assert done.returncode == 0, done.stderr
    words = ' '.join(done.stdout.split())
    assert 'images in 20 detections messages out 20 images dropped 0' in words
    named = [Path(line) for line in done.stdout.splitlines() if line.startswith(str(tmp_path))]
    assert sorted(named) == sorted(tmp_path.iterdir()), 'it names every file, and every named file is there'
    check_files(tmp_path)
    evaluated = subprocess.run(
        [sys.executable, '-m', 'motion_detect_ros', 'evaluate', tmp_path / 'detections.csv',
         '--truth', tmp_path / 'flight.truth.csv'], capture_output=True, text=True, timeout=600, check=False)
    assert evaluated.returncode == 0, evaluated.stderr


@pytest.mark.parametrize('name', ['flight.mcap', 'flight.mcap.part', 'detections.csv', 'demo.mp4', 'demo.json'])
def test_files_of_others_are_not_replaced(name: str, tmp_path: Path) -> None:
    (tmp_path / name).write_bytes(b'mine')
    done = demo('--offline', '--frames', str(FRAMES), '-o', tmp_path)
    assert (done.returncode, done.stderr) == (
        2, f'error: {tmp_path}/{name}: exists and is not of an earlier demo; choose another --output\n')
    assert {path.name: path.read_bytes() for path in tmp_path.iterdir()} == {name: b'mine'}


def test_a_record_nested_too_deep_is_of_others(tmp_path: Path) -> None:
    record = '[' * 100_000 + ']' * 100_000
    (tmp_path / 'demo.json').write_text(record)
    with pytest.raises(SourceError, match=r'demo\.json: exists and is not of an earlier demo'):
        begin(tmp_path, ['flight.mcap'])
    assert (tmp_path / 'demo.json').read_text() == record


def test_its_own_files_are_replaced(tmp_path: Path) -> None:
    words = ('--offline', '--frames', str(FRAMES), '-o', tmp_path)
    assert demo(*words).returncode == 0
    (tmp_path / 'flight.mcap.part').write_bytes(b'of a demo that was killed')
    again = demo(*words)
    assert (again.returncode, again.stderr) == (0, ''), again.stderr
    check_files(tmp_path)
    (tmp_path / 'flight.mcap').write_bytes(b'mine')
    other = demo(*words)
    assert (other.returncode, other.stderr.count('\n')) == (2, 1)
    assert 'flight.mcap: exists and is not of an earlier demo' in other.stderr
    assert (tmp_path / 'flight.mcap').read_bytes() == b'mine'


def test_live_over_dds(tmp_path: Path) -> None:
    """The real thing, short: four processes answer every image, exactly as one process does."""
    pytest.importorskip('rclpy')
    done = demo('--frames', str(FRAMES), '-o', tmp_path)
    assert done.returncode == 0, done.stdout + done.stderr
    words = ' '.join(done.stdout.split())
    assert 'images in 20 detections messages out 20 images dropped 0' in words
    assert 'largest difference to it 0 px' in words
    check_files(tmp_path)


def decimating(folder: Path, keep: int, of: int) -> Path:
    path = folder / 'few.yaml'
    path.write_text(f'/**: {{ros__parameters: {{load: {{decimation_keep: {keep}, decimation_of: {of}}}}}}}')
    return path


def check_decimated(done: subprocess.CompletedProcess[str], folder: Path) -> None:
    """2 of 5 of 20 images: all that are asked for."""
    assert done.returncode == 0, done.stdout + done.stderr
    words = ' '.join(done.stdout.split())
    assert 'images in 20 left out by the settings 12 detections messages out 8 images dropped 0' in words
    kept = [START_NS + frame * PERIOD_NS for frame in range(FRAMES) if frame % 5 < 2]
    assert stamps_in(folder / 'detections.mcap', '/detections') == kept


def test_settings_that_leave_images_out_over_dds(tmp_path: Path) -> None:
    """The end waits for no more images than were asked for, and those are as in one process."""
    pytest.importorskip('rclpy')
    done = demo('--frames', str(FRAMES), '-o', tmp_path / 'out', '--preset', decimating(tmp_path, 2, 5))
    check_decimated(done, tmp_path / 'out')
    assert 'largest difference to it 0 px' in ' '.join(done.stdout.split())


def test_settings_that_leave_images_out_offline(tmp_path: Path) -> None:
    done = demo('--offline', '--frames', str(FRAMES), '-o', tmp_path / 'out', '--preset', decimating(tmp_path, 2, 5))
    check_decimated(done, tmp_path / 'out')


def test_settings_that_leave_all_images_out_that_count(tmp_path: Path) -> None:
    """Of the first image alone there is nothing to score, which ends nothing."""
    done = demo('--offline', '--frames', str(FRAMES), '-o', tmp_path / 'out', '--preset', decimating(tmp_path, 1, 30))
    assert (done.returncode, done.stderr.count('Traceback')) == (0, 0), done.stderr
    assert 'left out by the settings 19 detections messages out 1' in ' '.join(done.stdout.split())


def test_without_ros_says_what_to_install(tmp_path: Path) -> None:
    """A Python that sees only what is not ROS: the site folder is searched, rclpy hidden from it."""
    code = ('import sys, importlib.util as util; find = util.find_spec\n'
            'util.find_spec = lambda name, *rest: None if name == "rclpy" else find(name, *rest)\n'
            'from motion_detect_ros.__main__ import main; sys.exit(main(["demo", "-o", sys.argv[1]]))')
    done = subprocess.run([sys.executable, '-c', code, str(tmp_path)], capture_output=True, text=True, timeout=600,
                          check=False)
    assert (done.returncode, done.stderr) == (
        2, 'error: rclpy is missing: install ROS 2 Jazzy or the extra "ros", or use --offline\n')
