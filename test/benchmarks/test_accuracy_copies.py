"""Means and deviations over copies of clips."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from motion_detect_ros.benchmarks import accuracy_copies
from motion_detect_ros.benchmarks.accuracy_clips import read_clips
from motion_detect_ros.benchmarks.accuracy_copies import COPIES, Copy, CopyJob, run_copy, table
from motion_detect_ros.core.types import DETECTION_DTYPE


def test_table_of_known_runs() -> None:
    found = np.zeros((2, len(COPIES), 3))
    found[0, :, 0] = [0.5, 0.7] * 4  # mean 0.6, deviation sqrt(8 * 0.01 / 7)
    found[1, :, 0] = [0.7, 0.5] * 4
    lines = table(['a', 'b'], found)
    assert lines[2] == '| `a` | 0.600 (0.107) | 0.000 (0.000) | 0.000 (0.000) |'
    assert lines[4] == '| mean of 2 | 0.600 (0.000) | 0.000 (0.000) | 0.000 (0.000) |'


@pytest.mark.parametrize('copy', COPIES, ids=str)
def test_what_is_found_in_a_copy_is_put_back(copy: Copy) -> None:
    """A spot is looked up in the copied picture, and comes back to where it was drawn."""
    image = np.zeros((20, 60), np.uint8)
    image[7, 33] = 255
    v, u = np.argwhere(copy.picture(image))[0]
    found = np.zeros(1, DETECTION_DTYPE)
    found['u'], found['v'] = u + 0.5, v + 0.5  # the middle of the pixel
    back = copy.undone(found, image.shape[1])
    assert (back['u'][0], back['v'][0]) == (33.5, 7.5)
    assert found['u'][0] == u + 0.5


@pytest.mark.parametrize('copy', COPIES, ids=str)
def test_a_square_is_found_in_every_copy(made: Path, copy: Copy) -> None:
    loose, _ = run_copy(CopyJob(read_clips(made, ['made_moves'])[0], {}, copy))
    assert loose.f1 > 0.5
    standing, _ = run_copy(CopyJob(read_clips(made, ['made_stands'])[0], {}, copy))
    assert standing.true_positives == standing.wanted == 0 < standing.false_positives


def test_wrong_settings_end_with_a_line(capsys: pytest.CaptureFixture[str], tmp_path: Path) -> None:
    assert accuracy_copies.main(['--data', str(tmp_path)]) == 2
    assert 'expected a folder with clips.json' in capsys.readouterr().err
