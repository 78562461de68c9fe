"""Starts over a clip whose mover is found in every frame but the first ones."""

from __future__ import annotations

import json
from pathlib import Path

import cv2
import numpy as np
import pytest

from motion_detect_ros.benchmarks import first_frames
from motion_detect_ros.benchmarks.accuracy_clips import Job, read_clips
from motion_detect_ros.benchmarks.first_frames import SHOWN, Starts, starts_of, table
from motion_detect_ros.core.types import TRUTH_DTYPE
from motion_detect_ros.sources.truth import write_truth

#: Two starts fit, a third one has five frames only.
FRAMES = 45


@pytest.fixture(scope='module')
def data(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A square of 60 px that moves 5 px a frame over ground that moves 2 px the other way."""
    folder = tmp_path_factory.mktemp('starts')
    random = np.random.default_rng(3)
    ground, thing = random.integers(0, 255, (270, 600), np.uint8), random.integers(0, 255, (60, 60), np.uint8)
    ground, thing = (cv2.GaussianBlur(image, (0, 0), 1.0) for image in (ground, thing))
    (folder / 'frames').mkdir()
    rows = []
    for index in range(FRAMES):
        image = ground[:, 2 * index:2 * index + 480].copy()
        left = 30 + 5 * index
        image[100:160, left:left + 60] = thing
        cv2.imwrite(str(folder / 'frames' / f'{index:04}.png'), image)
        rows.append((index, 1, left, 100, 60, 60, 1))
    write_truth(folder / 'truth.csv', np.array(rows, TRUTH_DTYPE))
    (folder / 'clips.json').write_text(json.dumps({
        'made_square': {'frames': 'frames', 'gt': 'truth.csv', 'fps': 25, 'preset': 'visdrone'}}))
    return folder


def test_the_pipeline_starts_anew(data: Path) -> None:
    found = starts_of(Job(read_clips(data)[0], {}))
    assert found.counts.shape == (2, 2, SHOWN, 3)
    assert (found.counts[..., 2] == 1).all()
    assert not found.counts[:, :, 0, 0].any()
    assert found.counts[:, 0, 6:, 0].all()
    assert found.recall(0) == 0.0 and found.recall(SHOWN - 1) == 1.0
    assert 0.7 < found.f1[0] <= 1.0


def test_figures_by_hand() -> None:
    """Found from frame 4 on in one start, never in the other, where two boxes in each frame are false."""
    counts = np.zeros((2, 2, SHOWN, 3), np.int64)
    counts[..., 2] = 1
    counts[0, 0, 4:, 0] = 1
    counts[1, :, :, 1] = 2
    found = Starts(None, counts)  # type: ignore[arg-type]
    # 8 of 20 wanted, 20 false: 2 * 8 / (8 + 20 + 20)
    assert found.f1.tolist() == [pytest.approx(1.0 / 3.0), 0.0]
    assert [found.recall(frame) for frame in (3, 4)] == [0.0, 0.5]


def test_table_and_wrong_use(data: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    document = tmp_path / 'figures.md'
    document.write_text('<!-- generated: first frames -->\n<!-- end: first frames -->\n')
    assert first_frames.main(['--data', str(data), '--jobs', '1', '--write', str(document)]) == 0
    lines = document.read_text().splitlines()
    assert lines[1].startswith('| clip | starts | F1 at 0.3 | F1 at 0.5 | recall in frame 2 |')
    assert [line.split(' | ')[:2] for line in lines[3:5]] == [['| `made_square`', '2'], ['| mean of 1', '2']]
    assert first_frames.main(['nothing', '--data', str(data)]) == 2
    assert 'clips: expected some of made_square, got nothing' in capsys.readouterr().err


def test_a_mean_without_anything_wanted(data: Path) -> None:
    nothing = Starts(read_clips(data)[0], np.zeros((1, 2, SHOWN, 3), np.int64))
    with np.errstate(all='raise'):
        assert np.isnan(nothing.recall(5))
    assert '| nan |' in table([nothing])[-1]
