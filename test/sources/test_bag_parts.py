"""Recordings of several files of which some are missing or unreadable: the others are read, and it is told."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
import yaml

from motion_detect_ros.__main__ import main
from motion_detect_ros.core.errors import SourceError
from motion_detect_ros.sources.bags import BagFrames, BagReader, BagWriter

STAMP, PERIOD = 1_600_000_000_000_000_000, 100_000_000


@pytest.fixture
def split(tmp_path: Path) -> Path:
    """Three files of five images, as ``ros2 bag record --max-bag-size`` leaves them."""
    folder = tmp_path / 'split'
    folder.mkdir()
    names = [f'split_{part}.mcap' for part in range(3)]
    for part, name in enumerate(names):
        with BagWriter(folder / name, compress=False) as writer:
            for index in range(5 * part, 5 * part + 5):
                writer.write_image(np.full((48, 64), index, np.uint8), STAMP + index * PERIOD)
    (folder / 'metadata.yaml').write_text(yaml.safe_dump({'rosbag2_bagfile_information': {
        'version': 5, 'storage_identifier': 'mcap', 'message_count': 15, 'relative_file_paths': names,
        'compression_mode': ''}}))
    return folder


def pictures_of(source: BagFrames) -> list[int]:
    return [int(frame.image[0, 0]) for frame in source]


def test_all_parts_are_one_recording(split: Path) -> None:
    source = BagFrames(split)
    assert (pictures_of(source), source.damaged) == ([*range(15)], None)


def test_a_missing_part_is_named(split: Path, capsys: pytest.CaptureFixture[str]) -> None:
    (split / 'split_1.mcap').unlink()
    source = BagFrames(split)
    assert source.damaged == 'split_1.mcap: missing part of the recording, numbers of the frames after it are too small'
    assert pictures_of(source) == [*range(5), *range(10, 15)]
    assert main(['inspect', str(split)]) == 3
    assert 'split_1.mcap: missing part' in capsys.readouterr().out


def test_nothing_comes_after_the_last_part(split: Path) -> None:
    (split / 'split_2.mcap').unlink()
    source = BagFrames(split)
    assert (pictures_of(source), source.damaged) == ([*range(10)], 'split_2.mcap: missing part of the recording')


def test_a_part_that_is_no_bag_costs_itself_only(split: Path) -> None:
    (split / 'split_0.mcap').write_bytes(bytes(100))
    source = BagFrames(split)
    assert pictures_of(source) == [*range(5, 15)]
    assert str(source.damaged).startswith(f'{split}/split_0.mcap: 100 bytes that are no bag; expected ')
    assert str(source.damaged).endswith(', numbers of the frames after it are too small')


def test_a_bag_none_of_whose_parts_can_be_read_is_refused(split: Path) -> None:
    for part in range(3):
        (split / f'split_{part}.mcap').write_bytes(bytes(100))
    with pytest.raises(SourceError, match=r'split_0.mcap: 100 bytes that are no bag'):
        BagReader(split)


def test_parts_under_other_names_than_those_listed_are_all_there_is(split: Path) -> None:
    """As after renaming folder and files."""
    for part in range(3):
        (split / f'split_{part}.mcap').rename(split / f'flight_{part}.mcap')
    source = BagFrames(split)
    assert (pictures_of(source), source.damaged) == ([*range(15)], None)


@pytest.mark.parametrize('listed', [7, 'split_0.mcap', [1, None], [['split_0.mcap']]])
def test_a_list_of_parts_that_makes_no_sense_is_not_believed(split: Path, listed: object) -> None:
    content = {'rosbag2_bagfile_information': {'relative_file_paths': listed}}
    (split / 'metadata.yaml').write_text(yaml.safe_dump(content))
    assert pictures_of(BagFrames(split)) == [*range(15)]


@pytest.mark.parametrize('text', ['{', '7', 'a: 2024-13-01', '[' * 3000 + ']' * 3000])
def test_a_description_that_makes_no_sense_is_not_believed(split: Path, text: str) -> None:
    """The last one is nested deeper than the parser goes."""
    (split / 'metadata.yaml').write_text(text)
    assert pictures_of(BagFrames(split)) == [*range(15)]
    for part in split.glob('*.mcap'):
        part.unlink()
    with pytest.raises(SourceError, match=r'split: found metadata.yaml; expected a bag \(metadata.yaml, \*.mcap, '):
        BagFrames(split)


def test_hidden_files_beside_the_parts_are_none(split: Path) -> None:
    """macOS leaves one beside each file on a disk of another system."""
    (split / 'metadata.yaml').unlink()
    for name in ('._split_0.mcap', '._split_1.mcap'):
        (split / name).write_bytes(b'\0\5\x16\7' + bytes(60))
    source = BagFrames(split)
    assert (pictures_of(source), source.damaged) == ([*range(15)], None)
