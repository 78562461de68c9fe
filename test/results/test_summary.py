"""summary.json: written whole, read back equal, refused in one line where it is none."""

from __future__ import annotations

import json
from dataclasses import asdict
from pathlib import Path

import pytest
from result_samples import summary

from motion_detect_ros.core.errors import SourceError
from motion_detect_ros.results.summary import Percentiles, read_summary, write_summary
from motion_detect_ros.results.tally import Tally


def test_percentiles_of_a_known_list() -> None:
    assert Percentiles.of([float(n) for n in range(101)]) == Percentiles(50.0, 95.0)
    assert Percentiles.of([]) == Percentiles(0.0, 0.0)


def test_what_is_read_is_what_was_written(tmp_path: Path) -> None:
    written = summary(fps=12.5)
    write_summary(tmp_path, written)
    assert read_summary(tmp_path) == written
    assert [path.name for path in tmp_path.iterdir()] == ['summary.json']


def test_a_field_of_a_later_version_is_ignored(tmp_path: Path) -> None:
    (tmp_path / 'summary.json').write_text(json.dumps({**asdict(summary()), 'weather': 'fine'}))
    assert read_summary(tmp_path) == summary()


@pytest.mark.parametrize('text', ['{', '[]', '7', '{"frames": 3}', '{"input": "x", "image_size": 4}'])
def test_what_is_no_summary_is_refused(text: str, tmp_path: Path) -> None:
    (tmp_path / 'summary.json').write_text(text)
    with pytest.raises(SourceError, match=r'summary\.json: expected the summary of a replay, got \w+Error: '):
        read_summary(tmp_path)


def test_a_folder_without_summary_is_refused(tmp_path: Path) -> None:
    with pytest.raises(SourceError, match='expected the summary of a replay: No such file or directory'):
        read_summary(tmp_path)


def test_times_of_two_hours_take_less_than_two_megabytes() -> None:
    tally = Tally()
    for _ in range(72_000):
        tally.read(0.5)
    assert tally.decode_ms.itemsize * len(tally.decode_ms) * (1 + len(tally.times_ms)) < 2e6
    assert (len(tally.decode_ms), Percentiles.of(tally.decode_ms)) == (72_000, Percentiles(0.5, 0.5))
