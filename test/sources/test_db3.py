"""db3 files as recorders leave them: with a write-ahead log beside them, and under any name."""

from __future__ import annotations

import shutil
import sqlite3
from pathlib import Path

import numpy as np
import pytest
from rosbags.rosbag2 import StoragePlugin, Writer
from rosbags.typesys import Stores, get_typestore

from motion_detect_ros.__main__ import main
from motion_detect_ros.core.errors import SourceError
from motion_detect_ros.sources import messages
from motion_detect_ros.sources.bags import BagFrames, BagReader

STAMP, PERIOD = 1_600_000_000_000_000_000, 100_000_000
STORE = get_typestore(Stores.ROS2_JAZZY)


def image(index: int) -> bytes:
    picture = messages.image(np.full((64, 64), index, np.uint8), STAMP + index * PERIOD, 'camera')
    return bytes(STORE.serialize_cdr(picture, messages.IMAGE))


@pytest.fixture
def bag(tmp_path: Path) -> Path:
    """Three images in one file."""
    with Writer(tmp_path / 'rec', version=9, storage_plugin=StoragePlugin.SQLITE3) as writer:
        connection = writer.add_connection('/image_raw', messages.IMAGE, typestore=STORE)
        for index in range(3):
            writer.write(connection, STAMP + index * PERIOD, image(index))
    return tmp_path / 'rec' / 'rec.db3'


def killed_recorder(bag: Path, folder: Path) -> Path:
    """Seven more images, written as ``--storage-preset-profile resilient`` does, and left as they were then."""
    folder.mkdir()
    with sqlite3.connect(bag) as database:
        database.execute('PRAGMA journal_mode=WAL')
        database.execute('PRAGMA wal_autocheckpoint=0')
        for index in range(3, 10):
            database.execute('INSERT INTO messages(topic_id, timestamp, data) VALUES(1, ?, ?)',
                             (STAMP + index * PERIOD, image(index)))
            database.commit()
        for end in ('', '-wal', '-shm'):
            shutil.copy(f'{bag}{end}', folder / f'cut_0.db3{end}')
    database.close()
    return folder / 'cut_0.db3'


def test_what_is_in_the_write_ahead_log_only_is_told_with_the_cure(
    bag: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str],
) -> None:
    cut = killed_recorder(bag, tmp_path / 'cut')
    source, size = BagFrames(cut.parent), (tmp_path / 'cut' / 'cut_0.db3-wal').stat().st_size
    assert source.damaged == (f'cut_0.db3: {size} bytes of cut_0.db3-wal are not read; '
                              f'they are taken over by: sqlite3 cut_0.db3 "PRAGMA wal_checkpoint(TRUNCATE)"')
    assert len([*source]) == 3
    assert main(['inspect', str(cut)]) == 3
    assert 'damaged: cut_0.db3: ' in capsys.readouterr().out


def test_the_cure_that_is_named_brings_the_messages(bag: Path, tmp_path: Path) -> None:
    cut = killed_recorder(bag, tmp_path / 'cut')
    database = sqlite3.connect(cut)
    database.execute('PRAGMA wal_checkpoint(TRUNCATE)')
    database.close()
    source = BagFrames(cut)
    assert [int(frame.image[0, 0]) for frame in source] == [*range(10)]
    assert source.damaged is None


def test_a_file_whose_tables_are_in_the_log_only_says_so(tmp_path: Path) -> None:
    path = tmp_path / 'a.db3'
    database = sqlite3.connect(path)
    database.execute('PRAGMA journal_mode=WAL')
    database.execute('CREATE TABLE topics(id INTEGER)')
    database.commit()
    with pytest.raises(SourceError, match=r'a.db3: not a readable bag: .*; \d+ bytes of a.db3-wal are not read; they '):
        BagReader(path)
    database.close()


@pytest.mark.parametrize('name', ['a#b', 'a?b', 'a%20b', '100%', 'a b', 'ü'])
def test_names_that_mean_something_in_addresses(bag: Path, tmp_path: Path, name: str) -> None:
    folder = tmp_path / f'in {name}'
    folder.mkdir()
    for path in (tmp_path / f'{name}.db3', folder / f'{name}.db3'):
        shutil.copy(bag, path)
        source = BagFrames(path)
        assert [int(frame.image[0, 0]) for frame in source] == [0, 1, 2]
        assert source.damaged is None


def test_the_name_of_a_file_that_is_no_bag_is_told_as_it_is(tmp_path: Path) -> None:
    path = tmp_path / 'a#b.db3'
    path.write_bytes(b'SQLite format 3\0' + bytes(500))
    with pytest.raises(SourceError, match=f'^{path}: not a readable bag: '):
        BagReader(path)
