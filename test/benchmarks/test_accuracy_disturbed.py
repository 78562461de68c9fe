"""Disturbed copies of clips: what is found in them comes back to where it was."""

from __future__ import annotations

from pathlib import Path

import cv2
import numpy as np
import pytest

from motion_detect_ros.benchmarks import accuracy_disturbed
from motion_detect_ros.benchmarks.accuracy_clips import read_clips
from motion_detect_ros.benchmarks.accuracy_disturbed import DISTURBANCES, NAMES, DisturbedJob, run_disturbed, undone
from motion_detect_ros.core.types import DETECTION_DTYPE

PICTURE = np.full((180, 320), 90, np.uint8)
PICTURE[70:100, 200:240] = 210


@pytest.mark.parametrize('disturbance', DISTURBANCES, ids=NAMES)
def test_what_is_found_in_a_disturbed_picture_is_put_back(disturbance: accuracy_disturbed.Disturbance) -> None:
    """The box of what is brighter than half way, by OpenCV."""
    for frame in range(3):
        image, matrix = disturbance.seen(PICTURE, frame)
        half = (int(image.max()) + int(np.median(image))) / 2.0
        left, top, width, height = cv2.boundingRect((cv2.medianBlur(image, 5) > half).astype(np.uint8))
        found = np.zeros(1, DETECTION_DTYPE)
        found['u'], found['v'], found['width'], found['height'] = left + width / 2, top + height / 2, width, height
        back = undone(found, matrix)[0]
        assert [back['u'], back['v'], back['width'], back['height']] == pytest.approx([220, 85, 40, 30], abs=2.5)


@pytest.mark.parametrize('number', range(1, len(DISTURBANCES)), ids=NAMES[1:])
def test_every_disturbance_changes_what_is_seen(number: int) -> None:
    seen = [DISTURBANCES[number].seen(PICTURE, frame)[0] for frame in range(18, 20)]
    assert DISTURBANCES[number].every > 1 or any(
        each.shape != PICTURE.shape or (each != PICTURE).any() for each in seen)
    np.testing.assert_array_equal(DISTURBANCES[0].seen(PICTURE, 0)[0], PICTURE)


@pytest.mark.parametrize('name', ['none', 'by 4 px and 0.25 degrees', 'two thirds of the size'])
def test_a_square_is_found_and_scored(made: Path, name: str) -> None:
    loose, _ = run_disturbed(DisturbedJob(read_clips(made, ['made_moves'])[0], {}, NAMES.index(name)))
    assert loose.f1 > 0.5
    standing, _ = run_disturbed(DisturbedJob(read_clips(made, ['made_stands'])[0], {}, NAMES.index(name)))
    assert standing.true_positives == standing.wanted == 0 < standing.false_positives


def test_every_second_frame_has_the_truth_of_its_own(made: Path) -> None:
    clip = read_clips(made, ['made_moves'])[0]
    numbers = (NAMES.index('none'), NAMES.index('every second frame'))
    (whole, _), (half, _) = (run_disturbed(DisturbedJob(clip, {}, number)) for number in numbers)
    assert 0 < half.frames < whole.frames
    assert (half.wanted, whole.wanted) == (half.frames, whole.frames), 'one square in every frame'


def test_table_of_known_runs(capsys: pytest.CaptureFixture[str], made: Path) -> None:
    assert accuracy_disturbed.main(['made_moves', '--data', str(made), '--only', 'none', '--jobs', '1']) == 0
    head, _, row = capsys.readouterr().out.strip().splitlines()[-3:]
    assert head == '| disturbance | F1 at 0.3 | F1 at 0.5 | precision | recall | false boxes a frame |'
    assert row.startswith('| none | ')


def test_wrong_settings_end_with_a_line(capsys: pytest.CaptureFixture[str], tmp_path: Path) -> None:
    assert accuracy_disturbed.main(['--data', str(tmp_path)]) == 2
    assert 'expected a folder with clips.json' in capsys.readouterr().err
