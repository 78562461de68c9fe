"""The plain methods on a made sequence: a textured square over panning textured ground; the table and the command."""

from __future__ import annotations

import json
import sys
from pathlib import Path

import cv2
import numpy as np
import pytest

from motion_detect_ros.benchmarks import plain_methods
from motion_detect_ros.benchmarks.plain_methods import DIFFERENCE, METHODS, RESIDUALS, ClipScores, find_boxes, table
from motion_detect_ros.core.types import TRUTH_DTYPE
from motion_detect_ros.results.metrics import overlaps
from motion_detect_ros.sources.frames import SourceFrame
from motion_detect_ros.sources.truth import write_truth

WIDTH, HEIGHT, SIDE, FRAMES = 320, 240, 44, 14
#: Pixels a frame: of the ground, which is not a whole number, and of the square over the image.
PAN_PX, STEP_PX = (2.5, -1.25), (5, 2)
#: First frame with two before it.
WARM_UP = 2


def texture(seed: int, height: int, width: int) -> np.ndarray:
    """Blurred noise over the whole range of grey levels."""
    rough = np.random.default_rng(seed).normal(size=(height, width)).astype(np.float32)
    return cv2.normalize(cv2.GaussianBlur(rough, (0, 0), 2.0), None, 30, 220, cv2.NORM_MINMAX)


def square_at(frame: int) -> np.ndarray:
    """(1, 4) x, y, w, h."""
    return np.array([(60 + STEP_PX[0] * frame, 30 + STEP_PX[1] * frame, SIDE, SIDE)], np.float64)


def pictures(moving: bool = True, larger: int = 1) -> list[SourceFrame]:
    """The sequence, with sensor noise. moving: with the square; larger: pixels of a pixel."""
    ground, square = texture(1, HEIGHT + 80, WIDTH + 80), texture(2, SIDE, SIDE)
    random, frames = np.random.default_rng(3), []
    for index in range(FRAMES):
        shift = np.array([(1, 0, PAN_PX[0] * index - 40), (0, 1, PAN_PX[1] * index - 20)])
        image = cv2.warpAffine(ground, shift, (WIDTH, HEIGHT), flags=cv2.INTER_CUBIC)
        if moving:
            x, y, w, h = square_at(index)[0].astype(int)
            image[y:y + h, x:x + w] = square
        noisy = np.clip(image + random.normal(0, 2, image.shape), 0, 255).astype(np.uint8)
        noisy = cv2.resize(noisy, None, fx=larger, fy=larger, interpolation=cv2.INTER_CUBIC)
        frames.append(SourceFrame(index, cv2.cvtColor(noisy, cv2.COLOR_GRAY2BGR), index * 40_000_000))
    return frames


def boxes_by(name: str, frames: list[SourceFrame], ignore_top_px: int = 0) -> dict[int, np.ndarray]:
    return find_boxes(frames, [METHODS[name]()], ignore_top_px)[0]


def found_in(boxes: dict[int, np.ndarray], larger: int = 1) -> list[bool]:
    """For each counted frame, whether a box lies on the square with an IoU over 0.3."""
    return [bool((overlaps(boxes[index], square_at(index) * larger)[0] > 0.3).any())
            for index in range(WARM_UP, FRAMES)]


@pytest.fixture(params=METHODS)
def name(request: pytest.FixtureRequest) -> str:
    if request.param == RESIDUALS:
        pytest.importorskip('sklearn', reason='DBSCAN is of scikit-learn: the extra compare')
    return str(request.param)


class TestMethods:
    def test_the_square_is_found(self, name: str) -> None:
        boxes = boxes_by(name, pictures())
        assert sorted(boxes) == list(range(FRAMES))
        assert all(each.dtype == np.float64 and each.shape[1:] == (4,) for each in boxes.values())
        assert np.mean(found_in(boxes)) > 0.8
        assert sum(map(len, boxes.values())) <= 1.5 * FRAMES, 'hardly any other box'

    def test_boxes_are_of_the_full_resolution(self, name: str) -> None:
        assert np.mean(found_in(boxes_by(name, pictures(larger=4)), larger=4)) > 0.8

    def test_next_to_nothing_where_nothing_moves(self, name: str) -> None:
        assert sum(map(len, boxes_by(name, pictures(moving=False)).values())) <= 1

    def test_nothing_in_rows_that_are_ignored(self, name: str) -> None:
        boxes = boxes_by(name, pictures(), ignore_top_px=110)
        assert square_at(FRAMES - 1)[0, [1, 3]].sum() < 110
        assert sum(map(len, boxes.values())) <= 1

    def test_nothing_and_no_error_without_texture(self, name: str) -> None:
        plain = [SourceFrame(index, np.full((HEIGHT, WIDTH), 90, np.uint8), index) for index in range(4)]
        mixed = [*plain, *(SourceFrame(frame.index + 4, frame.image, frame.stamp_ns) for frame in pictures())]
        boxes = boxes_by(name, mixed)
        assert all(len(boxes[index]) == 0 for index in range(5))
        assert np.mean(found_in({index: boxes[index + 4] for index in range(FRAMES)})) > 0.8


def test_ground_moves_as_it_was_panned() -> None:
    first, second = (cv2.cvtColor(frame.image, cv2.COLOR_BGR2GRAY) for frame in pictures()[:2])
    step = plain_methods.measure_step(first, second, np.full_like(first, 255))
    assert step is not None and len(step.start) == len(step.end) > 100
    np.testing.assert_allclose(step.motion, [(1, 0, PAN_PX[0]), (0, 1, PAN_PX[1])], atol=0.15)


def test_the_table_by_hand() -> None:
    rows = [ClipScores('a', {DIFFERENCE: (0.5, 0.1), RESIDUALS: (0.4, 0.2)}, (0.9, 0.8)),
            ClipScores('b', {DIFFERENCE: (0.1, 0.1), RESIDUALS: (0.2, 0.0)}, (0.7, 0.4))]
    assert table(rows) == [
        '| F1 at 0.3 / 0.5 | stabilised three-frame difference | KLT residuals + DBSCAN | best of the two | ours |',
        '|---|---|---|---|---|',
        '| `a` | 0.50 / 0.10 | 0.40 / 0.20 | 0.50 / 0.20 | 0.90 / 0.80 |',
        '| `b` | 0.10 / 0.10 | 0.20 / 0.00 | 0.20 / 0.10 | 0.70 / 0.40 |',
        '| mean of 2 | 0.30 / 0.10 | 0.30 / 0.10 | 0.35 / 0.15 | 0.80 / 0.60 |']


class TestCommand:
    @pytest.fixture
    def made(self, tmp_path: Path) -> Path:
        """A folder of one clip, the sequence."""
        (tmp_path / 'pictures').mkdir()
        for frame in pictures():
            assert cv2.imwrite(str(tmp_path / 'pictures' / f'{frame.index:06d}.png'), frame.image)
        truth = np.zeros(FRAMES, TRUTH_DTYPE)
        truth['frame'], truth['id'], truth['moving'] = np.arange(FRAMES), 1, 1
        for column, field in enumerate('xywh'):
            truth[field] = [square_at(index)[0, column] for index in range(FRAMES)]
        write_truth(tmp_path / 'truth.csv', truth)
        (tmp_path / 'clips.json').write_text(json.dumps({'made_square': {
            'frames': 'pictures', 'gt': 'truth.csv', 'fps': 25, 'preset': 'default'}}))
        return tmp_path

    def test_the_table_is_printed_and_written(self, made: Path, capsys: pytest.CaptureFixture[str]) -> None:
        pytest.importorskip('sklearn', reason='DBSCAN is of scikit-learn: the extra compare')
        document = made / 'table.md'
        document.write_text('<!-- generated: plain methods -->\n<!-- end: plain methods -->\n')
        assert plain_methods.main(['--data', str(made), '--jobs', '1', '--write', str(document)]) == 0
        lines = capsys.readouterr().out.splitlines()
        assert document.read_text().splitlines()[1:-1] == lines
        _, _, clip, mean = lines
        assert clip.replace('`made_square`', 'mean of 1') == mean
        loose = [float(cell.split('/')[0]) for cell in clip.split('|')[2:5]]
        assert min(loose[:2]) > 0.7 and loose[2] == max(loose[:2])

    def test_missing_data(self, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
        assert plain_methods.main(['--data', str(tmp_path / 'nowhere')]) == 2
        assert 'nowhere: expected a folder with clips.json' in capsys.readouterr().err

    def test_missing_library(
        self, made: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch,
    ) -> None:
        monkeypatch.setitem(sys.modules, 'sklearn', None)
        assert plain_methods.main(['--data', str(made), '--jobs', '1']) == 2
        assert capsys.readouterr().err == ('error: KLT residuals + DBSCAN: expected scikit-learn; '
                                           "install it: pip install 'motion_detect_ros[compare]'\n")
