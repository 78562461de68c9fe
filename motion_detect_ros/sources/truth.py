"""Ground truth in the forms people have it: VisDrone and MOT Challenge annotations, KITTI tracking labels, CSV."""

from __future__ import annotations

import csv
import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from motion_detect_ros.core.errors import SourceError
from motion_detect_ros.core.types import TRUTH_DTYPE, RecordArray
from motion_detect_ros.sources.part_file import part_of

CSV_COLUMNS = ('frame', 'id', 'x', 'y', 'w', 'h', 'moving')

_MOVES, _IGNORED = 1, -1
_MOVING = (_MOVES, 0, _IGNORED)
_VISDRONE_COLUMNS = 10
_VISDRONE_IGNORED_REGION = 0
_KITTI_COLUMNS = 17
#: A MOT file has at least frame, id and box; gt.txt of 2016 and later 9 columns, of 2015 10 with a position in space.
_MOT_COLUMNS = range(6, 11)
#: Classes of MOT16 to MOT20. What may or may not count: on a vehicle, non-motorised vehicle, static person, distractor,
#: reflection, crowd. No objects at all: occluders.
_MOT_UNSURE, _MOT_OCCLUDERS = frozenset({2, 6, 7, 8, 12, 13}), frozenset({9, 10, 11})
_Row = tuple[int, int, float, float, float, float, int]
_RowParser = Callable[[list[str]], _Row | None]


@dataclass(frozen=True)
class Truth:
    """``boxes``: ``TRUTH_DTYPE``; ``form``: the format read; ``says_what_moves``: False where the labels do not
    tell moving from standing objects, so that every object has ``moving`` = 1; ``first``: number of frame 0 in labels
    that number pictures, None where they count frames.
    """

    boxes: RecordArray
    form: str
    says_what_moves: bool
    first: int | None = None


def read_truth(path: str | Path) -> RecordArray:
    """Boxes of ``TRUTH_DTYPE`` from any known format; see ``load_truth``."""
    return load_truth(path).boxes


def load_truth(path: str | Path) -> Truth:
    """Read ground truth, telling the format by its first line.

    VisDrone MOT: ``frame,target,left,top,width,height,score,category,truncation,occlusion``, frames from 1;
    category 0 (ignored region) and score 0 count neither way. KITTI tracking: 17 columns, frames from 0, box as
    left top right bottom; DontCare counts neither way. MOT Challenge gt.txt:
    ``frame,id,left,top,width,height[,flag[,class[,visibility]]]``, frames and pixels from 1; flag 0 and the classes
    that its own evaluation leaves out count neither way, occluders are no objects. CSV: header
    ``frame,id,x,y,w,h[,moving]``, frames from 0; ``moving`` may be empty: not known.
    Raises: SourceError with the line that is wrong.
    """
    path = Path(path)
    try:
        lines = path.read_text(encoding='utf-8-sig').splitlines()
    except (OSError, UnicodeDecodeError) as error:
        reason = error.strerror if isinstance(error, OSError) else 'no text'
        raise SourceError(f'{path}: truth cannot be read: {reason}') from None
    blank = next((number for number, line in enumerate(lines) if line.strip()), 0)
    first = lines[blank] if lines else ''
    if 'frame' in [cell.strip(' "') for cell in first.split(',')]:
        return _load_csv(path, lines[blank:], blank)
    cells = first.strip().rstrip(',').split(',')
    if len(cells) == _VISDRONE_COLUMNS and all(cell.strip().isdigit() for cell in cells[7:]):
        return Truth(_parse(path, lines, ',', _visdrone_row, 1), 'VisDrone MOT annotation', False, 1)
    if len(cells) in _MOT_COLUMNS:
        return Truth(_parse(path, lines, ',', _mot_row, 1), 'MOT Challenge annotation', False, 1)
    if len(first.split()) == _KITTI_COLUMNS:
        return Truth(_parse(path, lines, None, _kitti_row, 0), 'KITTI tracking labels', False, 0)
    raise SourceError(
        f'{path}: first line {first[:60]!r}; expected a VisDrone annotation (10 columns, commas), a MOT Challenge '
        'annotation (6 to 10 columns, commas), KITTI tracking labels (17 columns, blanks) or a CSV with header '
        'frame,id,x,y,w,h[,moving]')


def finite_box(cells: Sequence[str]) -> list[float]:
    """The four numbers of a box. Raises: ValueError where one is none, or not finite."""
    try:
        box = [float(cell) for cell in cells]
    except (ValueError, TypeError):
        raise ValueError(f'expected a box of four numbers, got {", ".join(map(repr, cells))}') from None
    if not all(map(math.isfinite, box)):
        raise ValueError(f'expected a box of finite numbers, got {", ".join(f"{value:g}" for value in box)}')
    return box


def whole_number(cell: str, what: str) -> int:
    """The number of a cell, which may be written as 3.0. what: its column. Raises: ValueError where it is none."""
    number = float(cell)
    if not number.is_integer():
        raise ValueError(f'{what}: expected a whole number, got {cell.strip()}')
    return int(number)


def check_place(frame: int, width: float, height: float, first: int = 0) -> None:
    """first: what the file calls frame 0. Raises: ValueError for a frame before it, or a box of negative size."""
    if frame < 0:
        raise ValueError(f'expected frame {first} or later, got {frame + first}')
    if width < 0 or height < 0:
        raise ValueError(f'expected a width and height of 0 or more, got {width:g}, {height:g}')


def write_truth(path: str | Path, boxes: RecordArray, says_what_moves: bool = True) -> None:
    """Write boxes of ``TRUTH_DTYPE`` as CSV with all columns, whole or not at all; numbers read back exactly.

    says_what_moves: as in ``Truth``; without it ``moving`` stays empty where it is 1.
    """
    part = part_of(Path(path))
    with part.open('w', newline='', encoding='utf-8') as stream:
        writer = csv.writer(stream, lineterminator='\n')
        writer.writerow(CSV_COLUMNS)
        writer.writerows(boxes.tolist() if says_what_moves else
                         [(*row[:-1], '' if row[-1] == _MOVES else row[-1]) for row in boxes.tolist()])
    part.replace(path)


def _parse(path: Path, lines: list[str], separator: str | None, parse_row: _RowParser, first: int) -> RecordArray:
    rows = []
    for number, line in enumerate(lines, 1):
        if line.strip():
            try:
                row = parse_row(line.strip().rstrip(separator).split(separator))
                rows += [_fitting(row, first)] if row else []
            except (ValueError, IndexError, OverflowError) as error:
                raise SourceError(f'{path}, line {number}: {error}') from None
    return np.array(rows, TRUTH_DTYPE)


def _fitting(row: _Row, first: int = 0) -> _Row:
    """The row. Raises: ValueError as ``check_place``, OverflowError where a number of it does not fit its field."""
    frame, _, _, _, width, height, _ = row
    check_place(frame, width, height, first)
    np.array([row], TRUTH_DTYPE)
    return row


def _visdrone_row(cells: list[str]) -> _Row:
    frame, target = int(cells[0]), int(cells[1])
    x, y, w, h = finite_box(cells[2:6])
    counts = int(float(cells[6])) != 0 and int(cells[7]) != _VISDRONE_IGNORED_REGION
    return frame - 1, target, x, y, w, h, _MOVES if counts else _IGNORED


def _kitti_row(cells: list[str]) -> _Row:
    left, top, right, bottom = finite_box(cells[6:10])
    moving = _IGNORED if cells[2] == 'DontCare' else _MOVES
    return int(cells[0]), int(cells[1]), left, top, right - left, bottom - top, moving


def _mot_row(cells: list[str]) -> _Row | None:
    kind = -1 if len(cells) >= _VISDRONE_COLUMNS else whole_number(_mot_cell(cells, 7, '-1'), 'class')  # 2015: a place
    if kind in _MOT_OCCLUDERS:
        return None
    x, y, w, h = finite_box(cells[2:6])
    flag = float(_mot_cell(cells, 6, '1'))
    if not math.isfinite(flag):
        raise ValueError(f'flag: expected a finite number, got {flag:g}')
    return (whole_number(cells[0], 'frame') - 1, whole_number(cells[1], 'id'), x - 1, y - 1, w, h,
            _MOVES if flag and kind not in _MOT_UNSURE else _IGNORED)


def _mot_cell(cells: list[str], column: int, otherwise: str) -> str:
    return cells[column] if len(cells) > column and cells[column].strip() else otherwise


def _load_csv(path: Path, lines: list[str], skipped: int) -> Truth:
    """skipped: blank lines before these."""
    reader = csv.DictReader(lines, skipinitialspace=True)
    rows: list[_Row] = []
    unsaid = said = False
    try:
        columns = reader.fieldnames or []
        missing = [name for name in CSV_COLUMNS[:-1] if name not in columns and name != 'id']
        if missing:
            raise SourceError(f'{path}: column {", ".join(missing)} is missing; expected frame,id,x,y,w,h[,moving]')
        for cells in reader:
            rows.append(_fitting(_csv_row(cells)))
            unsaid |= not cells.get('moving')
            said |= bool(cells.get('moving')) and rows[-1][-1] != _IGNORED
    except (ValueError, TypeError, OverflowError) as error:
        raise SourceError(f'{path}, line {skipped + reader.line_num}: {error}') from None
    except csv.Error as error:  # the line is not counted yet
        raise SourceError(f'{path}, line {skipped + reader.line_num + 1}: {error}') from None
    return Truth(np.array(rows, TRUTH_DTYPE), 'CSV', 'moving' in columns and (said or not unsaid))


def _csv_row(cells: dict[str, str]) -> _Row:
    x, y, w, h = finite_box([cells[name] for name in ('x', 'y', 'w', 'h')])
    moving = whole_number(cells.get('moving') or str(_MOVES), 'moving')
    if moving not in _MOVING:
        raise ValueError(f'moving: expected 1, 0 or -1, got {moving}')
    return whole_number(cells['frame'], 'frame'), whole_number(cells.get('id') or '0', 'id'), x, y, w, h, moving
