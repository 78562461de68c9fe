"""The table of flow methods: truth on the grid, figures of a row, what is printed."""

from __future__ import annotations

from types import SimpleNamespace

import numpy as np
import pytest

from motion_detect_ros.benchmarks import flow_table
from motion_detect_ros.core.types import TRUTH_DTYPE


def test_cells_of_two_kinds_or_of_unknown_flow_are_of_neither() -> None:
    owner = np.zeros((16, 16), np.int32)
    owner[0:8, 0:6], owner[8:16, 8:16] = 7, 9
    truth = np.zeros(2, TRUTH_DTYPE)
    truth['id'], truth['moving'] = (7, 9), (1, 0)
    flow = np.zeros((16, 16, 2), np.float32)
    flow[..., 0] = np.arange(16)
    flow[13, 13] = np.nan
    cells = flow_table.truth_on_grid(SimpleNamespace(owner=owner, truth=truth, flow=flow), 4, 4)
    assert np.argwhere(cells.movers).tolist() == [[0, 0], [1, 0]]
    assert np.argwhere(~cells.background).tolist() == [[0, 0], [0, 1], [1, 0], [1, 1], [3, 3]]
    np.testing.assert_array_equal(cells.flow[0, :, 0], [1.5, 5.5, 9.5, 13.5])


def test_a_row_by_hand() -> None:
    row = flow_table.Row(np.array([0.1, 0.2, 0.9, np.nan]), np.array([1.0, np.nan]), [10.0, 30.0, 11.0])
    assert row.line('dis') == '| `dis` | 0.20 | 0.40 | 1.00 | 1.00 | 0.75 | 0.50 | 11 |'


def test_it_prints_a_row_for_each_method_and_refuses_a_wrong_setting(capsys: pytest.CaptureFixture[str]) -> None:
    assert flow_table.main(['--frames', '1', '--methods', 'dis', 'dis_ultrafast']) == 0
    lines = capsys.readouterr().out.splitlines()
    assert len(lines) == 4 and lines[2].startswith('| `dis` | 0.') and lines[0].count('|') == lines[2].count('|')
    assert flow_table.main(['--frames', '1', '--methods', 'dis', '--set', 'optical_flow.grid_px=0']) == 2
