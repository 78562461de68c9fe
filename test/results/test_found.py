"""detections.csv read back: bad cells are named by file and line; damaged bytes give an answer or one error of ours."""

from __future__ import annotations

import random
from pathlib import Path

import pytest

from motion_detect_ros.core.errors import SourceError
from motion_detect_ros.results.found import read_found, window_frames

HEADER = 'frame,id,x,y,w,h\n'


@pytest.mark.parametrize(('row', 'message'), [
    ('1,1,nan,2,3,4', 'expected a box of finite numbers, got nan, 2, 3, 4'),
    ('1,1,1,2,3,-inf', 'expected a box of finite numbers, got 1, 2, 3, -inf'),
    ('1,1,1,2,3', "expected a box of four numbers, got '1', '2', '3', None"),
    ('1,1,1,2,x,4', "expected a box of four numbers, got '1', '2', 'x', '4'"),
    ('1.7,1,1,2,3,4', 'frame: expected a whole number, got 1.7'),
    ('inf,1,1,2,3,4', 'frame: expected a whole number, got inf'),
    ('-1,1,1,2,3,4', 'expected frame 0 or later, got -1'),
    ('1,1.5,1,2,3,4', 'id: expected a whole number, got 1.5'),
    ('1,1,1,2,3,-4', 'expected a width and height of 0 or more, got 3, -4'),
    ('1,1,' + '9' * 131073 + ',2,3,4', 'field larger than field limit'),
])
def test_bad_cells_are_named_by_file_and_line(tmp_path: Path, row: str, message: str) -> None:
    path = tmp_path / 'found.csv'
    path.write_text(f'{HEADER}0,1,1,2,3,4\n{row}\n')
    with pytest.raises(SourceError, match=rf'found\.csv, line 3: .*{message}'):
        read_found(path)


def test_a_file_that_is_no_text(tmp_path: Path) -> None:
    path = tmp_path / 'flight.mcap'
    path.write_bytes(b'\x89MCAP0\r\n')
    with pytest.raises(SourceError, match=r'flight\.mcap: expected a CSV of detections, frame,x,y,w,h, got bytes that'):
        read_found(path)


def test_frames_with_a_huge_cell(tmp_path: Path) -> None:
    (tmp_path / 'summary.json').write_text('{"every": 2}')
    (tmp_path / 'frames.csv').write_text('frame\n' + '9' * 131073)
    with pytest.raises(SourceError, match=r'frames\.csv: expected a column frame of numbers, got Error'):
        window_frames(tmp_path / 'detections.csv')


def test_a_live_replay_has_no_list_of_frames(tmp_path: Path) -> None:
    (tmp_path / 'summary.json').write_text(
        '{"live": true, "settings": {"load.decimation_keep": 1, "load.decimation_of": 2}}')
    assert window_frames(tmp_path / 'detections.csv') is None


def test_damaged_bytes(tmp_path: Path) -> None:
    chance, path = random.Random(5), tmp_path / 'found.csv'
    whole = (HEADER + ''.join(f'{frame},1,10,20,30,40\n' for frame in range(5))).encode()
    read = 0
    for _ in range(1000):
        data = bytearray(whole)
        for _ in range(chance.randint(1, 4)):
            place = chance.randrange(len(data))
            data[place:place + chance.choice((0, 1, 4))] = chance.choice((b'', b'"', b'\n', b',', b'nan', b'1e999',
                                                                         b'\x00', b'\xff', chance.randbytes(4)))
        path.write_bytes(data)
        try:
            read_found(path)
            read += 1
        except SourceError as error:
            assert str(error).startswith(str(path))
            assert '\n' not in str(error)
    assert 0 < read < 1000


@pytest.mark.parametrize(('ident', 'message'), [
    (2**32, 'expected ids below 4294967296, got 4294967296'),
    (-1, 'expected a column id, found none'),
])
def test_ids_that_no_record_holds(tmp_path: Path, ident: int, message: str) -> None:
    path = tmp_path / 'found.csv'
    path.write_text(f'{HEADER}0,4294967295,1,2,3,4\n')
    assert read_found(path).records()[0]['id'].tolist() == [2**32 - 1]
    path.write_text(f'{HEADER}0,4294967295,1,2,3,4\n0,{ident},1,2,3,4\n')
    with pytest.raises(SourceError, match=f'detections: {message}'):
        read_found(path).records()


def test_a_summary_nested_too_deep(tmp_path: Path) -> None:
    (tmp_path / 'summary.json').write_text('[' * 100_000)
    with pytest.raises(SourceError, match=r'summary\.json: expected the count source_frames, got RecursionError'):
        window_frames(tmp_path / 'detections.csv')


def test_files_that_begin_with_a_byte_order_mark(tmp_path: Path) -> None:
    path = tmp_path / 'detections.csv'
    path.write_text(f'{HEADER}3,1,1,2,3,4\n', encoding='utf-8-sig')
    assert read_found(path).boxes[3].tolist() == [[1, 2, 3, 4]]
    (tmp_path / 'summary.json').write_text('{"every": 2}')
    (tmp_path / 'frames.csv').write_text('frame\n3\n', encoding='utf-8-sig')
    assert window_frames(path) == {3}
