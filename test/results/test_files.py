"""Files under construction on a full disk."""

from __future__ import annotations

import resource
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import pytest

from motion_detect_ros.core.errors import SourceError
from motion_detect_ros.results.files import TextFile, write_whole
from motion_detect_ros.results.ownership import owned


@contextmanager
def largest_file(size: int) -> Iterator[None]:
    """The kernel refuses what goes over it, as it does on a full disk."""
    soft, hard = resource.getrlimit(resource.RLIMIT_FSIZE)
    resource.setrlimit(resource.RLIMIT_FSIZE, (size, hard))
    try:
        yield
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, (soft, hard))


def test_a_line_that_finds_no_room_is_taken_back(tmp_path: Path):
    with pytest.raises(OSError, match='too large'), TextFile(tmp_path / 'a.csv', 'head') as file, largest_file(20):
        for number in range(9):  # five bytes, two lines of seven, and one byte
            file.add(f'row {number},')
    assert (tmp_path / 'a.csv.part').read_text() == 'head\nrow 0,\nrow 1,\n'
    assert not (tmp_path / 'a.csv').exists()


def test_lines_added_together_are_taken_back_together(tmp_path: Path):
    with pytest.raises(OSError, match='too large'), TextFile(tmp_path / 'a.csv', 'head') as file, largest_file(20):
        file.add('row 0,')
        file.add('row 1,', 'row 2,')  # there is room for the first of them
    assert (tmp_path / 'a.csv.part').read_text() == 'head\nrow 0,\n'


def test_a_line_after_one_that_found_no_room_is_where_that_began(tmp_path: Path):
    """As the end of coco.json, once there is room again."""
    with TextFile(tmp_path / 'a.csv', 'head') as file:
        with largest_file(8), pytest.raises(OSError, match='too large'):
            file.add('row 0,')
        file.add('row 1,')
    assert (tmp_path / 'a.csv').read_bytes() == b'head\nrow 1,\n'


def test_a_small_file_that_finds_no_room_is_not_there(tmp_path: Path):
    write_whole(tmp_path / 'summary.json', 'earlier')
    with pytest.raises(OSError, match='too large'), largest_file(8):
        write_whole(tmp_path / 'summary.json', 'something longer')
    assert {path.name: path.read_text() for path in tmp_path.iterdir()} == {'summary.json': 'earlier'}


def test_a_folder_without_room_for_its_lock_is_said_and_left_as_it_was(tmp_path: Path):
    with largest_file(0), pytest.raises(SourceError, match=f'{tmp_path}: cannot be written: File too large'), \
            owned(tmp_path):
        pass
    assert not [*tmp_path.iterdir()]
    with owned(tmp_path) as owner:
        assert owner.holds()
