"""Recall by size and own speed: speeds and cells worked by hand, a clip whose camera pans by a known step."""

from __future__ import annotations

import json
from pathlib import Path

import cv2
import numpy as np
import pytest

from motion_detect_ros.benchmarks import accuracy_clips, recall_table
from motion_detect_ros.benchmarks.accuracy_clips import Clip, Job, read_clips
from motion_detect_ros.benchmarks.recall_table import (
    SIZES_PX,
    SPEEDS_PX,
    RecallCounts,
    count,
    count_clip,
    follow_clip,
    own_speeds,
    table,
    total,
)
from motion_detect_ros.core.types import (
    TRUTH_DTYPE,
    DoubleArray,
    EgoMotion,
    EgoStatus,
    FlowField,
    RecordArray,
    Result,
    empty_detections,
)
from motion_detect_ros.sources.truth import write_truth

#: What static ground moves by in the picture, pixels a frame: the camera pans.
PAN = np.array([7.0, -2.0])
FRAMES = 16


def shift(dx: float, dy: float) -> DoubleArray:
    return np.array([[1.0, 0.0, dx], [0.0, 1.0, dy], [0.0, 0.0, 1.0]])


def panned(frame: int, back: int) -> dict[int, DoubleArray]:
    """The motion into a frame from each of the ``back`` frames before it, latest first."""
    return {frame - ago: shift(*(ago * PAN)) for ago in range(1, back + 1)}


def boxes(*rows: tuple[float, ...]) -> RecordArray:
    """Moving objects from (frame, id, x, y, w, h)."""
    return np.array([(*row, 1) for row in rows], TRUTH_DTYPE)


def speeds_at(frame: int, truth: RecordArray, carried: dict[int, DoubleArray]) -> list[float]:
    return own_speeds(truth[truth['frame'] == frame], truth, carried).tolist()


class TestOwnSpeed:
    def test_is_what_the_pan_does_not_explain(self) -> None:
        """Ground moves (7, -2): object 1 by (3, 4) more, 5 px a frame; object 2 not at all; the size may change."""
        truth = boxes(*((frame, 1, 100 + 10 * frame, 50 + 2 * frame, 20, 10) for frame in range(6)),
                      *((frame, 2, 200 + 7 * frame - frame, 90 - 2 * frame, 30 + 2 * frame, 10) for frame in range(6)))
        assert speeds_at(5, truth, panned(5, 5)) == [5.0, 0.0]

    def test_is_from_the_earliest_frame(self) -> None:
        """Stood for four frames, then a step of 10 px: 2 px a frame over five frames, 10 over the last one."""
        truth = boxes(*((frame, 1, 100 + 7 * frame + (10 if frame == 5 else 0), 50 - 2 * frame, 20, 10)
                        for frame in range(6)))
        assert speeds_at(5, truth, panned(5, 5)) == [2.0]
        assert speeds_at(5, truth, panned(5, 1)) == [10.0]

    def test_of_young_objects_and_of_those_just_seen(self) -> None:
        """Object 1 is two frames old and went (3, 0) + (5, 0); object 2 is new."""
        truth = boxes((3, 1, 100, 50, 20, 10), (4, 1, 110, 48, 20, 10), (5, 1, 122, 46, 20, 10), (5, 2, 0, 0, 20, 10))
        assert speeds_at(5, truth, panned(5, 5)) == [4.0, pytest.approx(np.nan, nan_ok=True)]

    def test_over_a_gap_in_the_truth(self) -> None:
        """Away for three frames; 12 px in 4 frames."""
        truth = boxes((1, 1, 100, 50, 20, 10), (5, 1, 140, 42, 20, 10))
        assert speeds_at(5, truth, panned(5, 5)) == [3.0]

    def test_without_ego_motion(self) -> None:
        truth = boxes((4, 1, 100, 50, 20, 10), (5, 1, 107, 48, 20, 10))
        assert np.isnan(speeds_at(5, truth, {})).all()

    def test_zooms_about_pixel_centres(self) -> None:
        """Centre 10.5 in edges is pixel 10, twice as far 20; 23.5 is pixel 23, so 3 px further."""
        truth = boxes((0, 1, 8, 8, 5, 5), (1, 1, 21, 18, 5, 5))
        assert speeds_at(1, truth, {0: np.diag([2.0, 2.0, 1.0])}) == [3.0]


class TestCells:
    @pytest.mark.parametrize(('side', 'row'), [
        (11.9, 0), (12, 1), (15.9, 1), (16, 2), (24, 3), (32, 4), (48, 5), (95.9, 5), (96, 6), (500, 6)])
    def test_rows(self, side: float, row: int) -> None:
        """Half as wide as high or not: the square root of the area decides."""
        found = count(boxes((0, 1, 0, 0, side / 2, side * 2)), np.array([True]), np.array([1.5]))
        assert np.argwhere(found.wanted).tolist() == np.argwhere(found.hits).tolist() == [[row, 2]]

    @pytest.mark.parametrize(('speed', 'column'), [
        (0, 0), (0.49, 0), (0.5, 1), (0.99, 1), (1, 2), (2, 3), (3.99, 3), (4, 4), (30, 4)])
    def test_columns(self, speed: float, column: int) -> None:
        found = count(boxes((0, 1, 0, 0, 20, 20)), np.array([False]), np.array([speed]))
        assert np.argwhere(found.wanted).tolist() == [[2, column]] and not found.hits.any()

    def test_boxes_of_unknown_speed_are_left_out(self) -> None:
        three = boxes((0, 1, 0, 0, 20, 20), (0, 2, 0, 0, 20, 20), (0, 3, 0, 0, 20, 20))
        found = count(three, np.array([True, True, False]), np.array([np.nan, 1.5, 1.5]))
        assert (found.wanted.sum(), found.wanted[2, 2], found.hits[2, 2], found.left_out) == (2, 2, 1, 1)

    def test_no_boxes(self) -> None:
        assert count(boxes(), np.zeros(0, bool), np.zeros(0)).wanted.sum() == total([]).wanted.sum() == 0


def test_table() -> None:
    """Nine boxes say too little; ten of two clips do."""
    wanted = np.zeros((len(SIZES_PX) + 1, len(SPEEDS_PX) + 1), np.int64)
    hits = wanted.copy()
    wanted[0, 0], hits[0, 0], wanted[6, 4], hits[6, 4] = 9, 9, 5, 1
    one, both = RecallCounts(hits, wanted, 3), total([RecallCounts(hits, wanted, 3)] * 2)
    assert table(one)[0] == '| size, px; own speed, px/frame: | under 0.5 | 0.5-1 | 1-2 | 2-4 | over 4 |'
    assert [line.split(' | ')[0] for line in table(one)[2:9]] == [
        '| under 12', '| 12-16', '| 16-24', '| 24-32', '| 32-48', '| 48-96', '| over 96']
    assert table(one)[2] == '| under 12 |  |  |  |  |  |'
    assert table(both)[2] == '| under 12 | 100 % of 18 |  |  |  |  |'
    assert table(both)[8] == '| over 96 |  |  |  |  | 20 % of 10 |'
    assert table(both)[10] == 'Together 71 % of 28 boxes; 6 without an earlier one left out.'


class Panning:
    """Stands in for the pipeline: knows the pan, loses it at frame 9, finds object 1 in frames with even numbers."""

    def __init__(self, *_: object) -> None:
        self._frame, self._stamp_ns = -1, 0

    def process(self, _image: object, stamp_ns: int) -> Result:
        self._frame += 1
        status = {0: EgoStatus.FIRST_FRAME, 9: EgoStatus.DEGENERATE}.get(self._frame, EgoStatus.OK)
        matrix = shift(*PAN) if status == EgoStatus.OK else np.eye(3)
        ego = EgoMotion(matrix, np.zeros((6, 6)), status, stamp_ns, self._stamp_ns)
        self._stamp_ns = stamp_ns
        found = empty_detections(1 - self._frame % 2)
        found['u'], found['v'], found['width'], found['height'] = 110 + 10 * self._frame, 55 + 2 * self._frame, 20, 10
        return Result(stamp_ns, ego, FlowField(np.zeros((1, 1, 2), np.float32), 8, 8, stamp_ns), found)


@pytest.fixture
def data(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """Two clips with object 1 of 20 x 10 px, 5 px a frame faster than the ground; one is not completely labelled."""
    monkeypatch.setattr(accuracy_clips, 'MotionPipeline', Panning)
    (tmp_path / 'pictures').mkdir()
    for frame in range(FRAMES):
        assert cv2.imwrite(str(tmp_path / 'pictures' / f'{frame:06d}.png'), np.zeros((8, 8), np.uint8))
    write_truth(tmp_path / 'truth.csv', boxes(
        *((frame, 1, 100 + 10 * frame, 50 + 2 * frame, 20, 10) for frame in range(FRAMES))))
    entry = {'frames': 'pictures', 'gt': 'truth.csv', 'fps': 20, 'preset': 'default'}
    (tmp_path / 'clips.json').write_text(json.dumps({
        'made_whole': entry, 'made_part': {**entry, 'complete_gt': False}}))
    return tmp_path


def made(data: Path) -> Clip:
    return read_clips(data, ['made_whole'])[0]


class TestClip:
    def test_ego_motions_are_chained_until_one_is_missing(self, data: Path) -> None:
        _, carried = follow_clip(Job(made(data), {}))
        assert {frame: list(motions) for frame, motions in carried.items() if frame in {0, 2, 8, 9, 11}} == {
            0: [], 2: [1, 0], 8: [7, 6, 5, 4, 3], 9: [], 11: [10, 9]}
        np.testing.assert_array_equal(carried[8][3], shift(35, -10))

    def test_counts(self, data: Path) -> None:
        """14 frames after two of warm-up, 9 without ego-motion; found in 2, 4, ... 14. Size 14.1 px, 5 px a frame."""
        counts = count_clip(Job(made(data), {}))
        assert np.argwhere(counts.wanted).tolist() == [[1, 4]]
        assert (counts.wanted[1, 4], counts.hits[1, 4], counts.left_out) == (13, 7, 1)

    def test_command_takes_the_complete_clips(self, data: Path, capsys: pytest.CaptureFixture[str]) -> None:
        page = data / 'page.md'
        page.write_text('<!-- generated: recall -->\n<!-- end: recall -->\nrest\n')
        assert recall_table.main(['--data', str(data), '--jobs', '1', '--write', str(page)]) == 0
        out = capsys.readouterr().out
        assert '| 12-16 |  |  |  |  | 54 % of 13 |' in out and 'made' not in out
        assert page.read_text() == f'<!-- generated: recall -->\n{out}<!-- end: recall -->\nrest\n'

    def test_command_for_each_clip(self, data: Path, capsys: pytest.CaptureFixture[str]) -> None:
        assert recall_table.main(['made_whole', 'made_part', '--data', str(data), '--jobs', '1', '--each']) == 0
        blocks = capsys.readouterr().out.split('`:\n')
        assert [block.split('54 % of ')[1].split(' |')[0] for block in blocks] == ['26', '13', '13']
        assert blocks[0].endswith('`made_whole') and blocks[1].endswith('`made_part')


class TestRefusals:
    def test_no_folder(self, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
        assert recall_table.main(['--data', str(tmp_path / 'none')]) == 2
        assert 'none: expected a folder with clips.json; set MOTION_DETECT_DATA or --data' in capsys.readouterr().err

    def test_no_complete_clip(self, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
        (tmp_path / 'clips.json').write_text('{}')
        assert recall_table.main(['--data', str(tmp_path)]) == 2
        assert 'expected clips with complete_gt, found none' in capsys.readouterr().err

    def test_wrong_setting(self, data: Path, capsys: pytest.CaptureFixture[str]) -> None:
        assert recall_table.main(['--data', str(data), '--jobs', '1', '--set', 'tracks.hits=3']) == 2
        assert "unknown setting 'tracks.hits'" in capsys.readouterr().err
