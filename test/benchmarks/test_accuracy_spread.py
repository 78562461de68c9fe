"""Means and deviations over like runs."""

from __future__ import annotations

import numpy as np
import pytest

from motion_detect_ros.benchmarks import accuracy_spread
from motion_detect_ros.benchmarks.accuracy_spread import CORNERS, table


def test_table_of_known_runs() -> None:
    found = np.zeros((2, len(CORNERS), 3))
    found[0, :, 0] = [0.5, 0.7, 0.5, 0.7]  # mean 0.6, deviation sqrt(4 * 0.01 / 3)
    found[1, :, 0] = [0.7, 0.5, 0.7, 0.5]
    lines = table(['a', 'b'], found)
    assert lines[2] == '| `a` | 0.600 (0.115) | 0.000 (0.000) | 0.000 (0.000) |'
    assert lines[4] == '| mean of 2 | 0.600 (0.000) | 0.000 (0.000) | 0.000 (0.000) |'


def test_wrong_settings_end_with_a_line(capsys: pytest.CaptureFixture[str], tmp_path) -> None:
    assert accuracy_spread.main(['--data', str(tmp_path)]) == 2
    assert 'expected a folder with clips.json' in capsys.readouterr().err
