"""The table of throughput, without measuring anything."""

from __future__ import annotations

from motion_detect_ros.benchmarks.throughput import Row, table


def test_table_by_hand():
    rows = [Row('processes', 1, 8.0, 9.5, True), Row('processes', 2, 5.0, 9.75, True), Row('Dask', 1, 10.0, 11.0, True),
            Row('Dask', 2, 4.0, 12.0, False)]
    assert table(rows, 4, 20)[4:] == [
        '| processes | 1 | 8.0 | 10 | 1.00 | 9.5 | yes |', '| processes | 2 | 5.0 | 16 | 1.60 | 9.8 | yes |',
        '| Dask | 1 | 10.0 | 8 | 1.00 | 11.0 | yes |', '| Dask | 2 | 4.0 | 20 | 2.50 | 12.0 | NO |']
