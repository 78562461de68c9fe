"""detections.parquet, as pyarrow reads it."""

from __future__ import annotations

import sys
from pathlib import Path

import numpy as np
import pytest
from result_samples import FOUND, UNKNOWN, interrupted, write

from motion_detect_ros.__main__ import main
from motion_detect_ros.core.errors import BackendError
from motion_detect_ros.core.types import DETECTION_DTYPE
from motion_detect_ros.results import detection_parquet

parquet = pytest.importorskip('pyarrow.parquet', reason='pip install motion_detect_ros[parquet]')

NAME = 'detections.parquet'


def test_columns_and_rows_by_hand(tmp_path: Path) -> None:
    write(tmp_path, 'parquet')
    table = parquet.read_table(tmp_path / NAME)
    assert table.column_names[:12] == [
        'input', 'frame', 'stamp_ns', 'id', 'x', 'y', 'w', 'h', 'score', 'vel_u', 'vel_v', 'ttc']
    moved = {'u', 'v', 'width', 'height'}
    assert set(DETECTION_DTYPE.names or ()) - moved <= set(table.column_names)
    assert moved.isdisjoint(table.column_names)
    rows = table.to_pylist()
    assert [(row['frame'], row['stamp_ns'], row['id']) for row in rows] == [
        (0, 10**9, 7), (1, 1050 * 10**6, 7), (1, 1050 * 10**6, 9)]
    assert [(row['x'], row['y'], row['w'], row['h'], row['score']) for row in rows] == [
        (45, 18, 11, 4, 0.25), (47, 18, 11, 4, 0.5), (284, 192, 32, 16.5, 0.75)]
    assert {row['input'] for row in rows} == {'flight.mcap'}
    assert np.isnan(rows[0]['ttc'])


def test_types_are_the_same_with_and_without_rows(tmp_path: Path) -> None:
    write(tmp_path, 'parquet')
    full = parquet.read_schema(tmp_path / NAME)
    write(tmp_path, 'parquet', found=[FOUND[2]])
    assert parquet.read_schema(tmp_path / NAME) == full
    assert parquet.read_table(tmp_path / NAME).num_rows == 0
    assert [str(full.field(name).type) for name in ('frame', 'stamp_ns', 'id', 'x', 'score')] == [
        'int64', 'int64', 'uint32', 'double', 'float']


def test_rows_reach_the_disk_group_by_group(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(detection_parquet, 'GROUP_ROWS', 3)
    write(tmp_path, 'parquet', found=[*FOUND, *FOUND, FOUND[0], UNKNOWN])
    file = parquet.ParquetFile(tmp_path / NAME)
    assert [file.metadata.row_group(number).num_rows for number in range(file.num_row_groups)] == [3, 3, 2]
    assert file.read().column('id').to_pylist() == [7, 7, 9, 7, 7, 9, 7, 11]


def test_two_files_are_byte_identical(tmp_path: Path) -> None:
    write(tmp_path, 'parquet')
    first = (tmp_path / NAME).read_bytes()
    write(tmp_path, 'parquet')
    assert (tmp_path / NAME).read_bytes() == first


def test_what_an_interrupted_run_leaves_is_readable(tmp_path: Path) -> None:
    interrupted(tmp_path, 'parquet')
    assert [path.name for path in tmp_path.iterdir()] == [f'{NAME}.part']
    assert parquet.read_table(tmp_path / f'{NAME}.part').num_rows == 3


def test_without_pyarrow_one_line_says_what_to_install(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str],
) -> None:
    monkeypatch.setitem(sys.modules, 'pyarrow', None)
    assert main(['replay', 'flight.mcap', '-o', str(tmp_path / 'out'), '--formats', 'parquet']) == 2
    assert capsys.readouterr().err == ('error: --formats parquet: expected the package pyarrow; '
                                       'pip install pyarrow\n')
    assert not (tmp_path / 'out').exists()
    with pytest.raises(BackendError, match='expected the package pyarrow; pip install pyarrow'):
        write(tmp_path, 'parquet')
