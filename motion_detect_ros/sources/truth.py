"""Ground truth in the forms people have it: VisDrone MOT annotations, KITTI tracking labels, plain CSV."""

from __future__ import annotations

import csv
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from motion_detect_ros.core.errors import SourceError
from motion_detect_ros.core.types import TRUTH_DTYPE, RecordArray

CSV_COLUMNS = ('frame', 'id', 'x', 'y', 'w', 'h', 'moving')

_MOVES, _IGNORED = 1, -1
_VISDRONE_COLUMNS = 10
_VISDRONE_IGNORED_REGION = 0
_KITTI_COLUMNS = 17
_Row = tuple[int, int, float, float, float, float, int]
_RowParser = Callable[[list[str]], _Row]


@dataclass(frozen=True)
class Truth:
    """``boxes``: ``TRUTH_DTYPE``; ``form``: the format read; ``says_what_moves``: False where the labels do not
    tell moving from standing objects, so that every object has ``moving`` = 1.
    """

    boxes: RecordArray
    form: str
    says_what_moves: bool


def read_truth(path: str | Path) -> RecordArray:
    """Boxes of ``TRUTH_DTYPE`` from any known format; see ``load_truth``."""
    return load_truth(path).boxes


def load_truth(path: str | Path) -> Truth:
    """Read ground truth, telling the format by its first line.

    VisDrone MOT: ``frame,target,left,top,width,height,score,category,truncation,occlusion``, frames from 1;
    category 0 (ignored region) and score 0 count neither way. KITTI tracking: 17 columns, frames from 0, box as
    left top right bottom; DontCare counts neither way. CSV: header ``frame,id,x,y,w,h[,moving]``, frames from 0.
    Raises: SourceError with the line that is wrong.
    """
    path = Path(path)
    try:
        lines = path.read_text(encoding='utf-8-sig').splitlines()
    except (OSError, UnicodeDecodeError) as error:
        reason = error.strerror if isinstance(error, OSError) else 'no text'
        raise SourceError(f'{path}: truth cannot be read: {reason}') from None
    first = next((line for line in lines if line.strip()), '')
    if 'frame' in first.split(','):
        return _load_csv(path, lines)
    if len(first.rstrip(',').split(',')) == _VISDRONE_COLUMNS:
        return Truth(_parse(path, lines, ',', _visdrone_row), 'VisDrone MOT annotation', False)
    if len(first.split()) == _KITTI_COLUMNS:
        return Truth(_parse(path, lines, None, _kitti_row), 'KITTI tracking labels', False)
    raise SourceError(
        f'{path}: first line {first[:60]!r}; expected a VisDrone annotation (10 columns, commas), KITTI tracking '
        'labels (17 columns, blanks) or a CSV with header frame,id,x,y,w,h[,moving]')


def write_truth(path: str | Path, boxes: RecordArray) -> None:
    """Write boxes of ``TRUTH_DTYPE`` as CSV with all columns; numbers read back exactly."""
    with Path(path).open('w', newline='', encoding='utf-8') as stream:
        writer = csv.writer(stream, lineterminator='\n')
        writer.writerow(CSV_COLUMNS)
        writer.writerows(boxes.tolist())


def _parse(path: Path, lines: list[str], separator: str | None, parse_row: _RowParser) -> RecordArray:
    rows = []
    for number, line in enumerate(lines, 1):
        if line.strip():
            try:
                rows.append(_fitting(parse_row(line.split(separator))))
            except (ValueError, IndexError, OverflowError) as error:
                raise SourceError(f'{path}, line {number}: {error}') from None
    return np.array(rows, TRUTH_DTYPE)


def _fitting(row: _Row) -> _Row:
    """The row. Raises: OverflowError where a number of it does not fit its field."""
    np.array([row], TRUTH_DTYPE)
    return row


def _visdrone_row(cells: list[str]) -> _Row:
    frame, target = int(cells[0]), int(cells[1])
    x, y, w, h = (float(cell) for cell in cells[2:6])
    counts = int(float(cells[6])) != 0 and int(cells[7]) != _VISDRONE_IGNORED_REGION
    return frame - 1, target, x, y, w, h, _MOVES if counts else _IGNORED


def _kitti_row(cells: list[str]) -> _Row:
    left, top, right, bottom = (float(cell) for cell in cells[6:10])
    moving = _IGNORED if cells[2] == 'DontCare' else _MOVES
    return int(cells[0]), int(cells[1]), left, top, right - left, bottom - top, moving


def _load_csv(path: Path, lines: list[str]) -> Truth:
    reader = csv.DictReader(lines)
    columns = reader.fieldnames or []
    missing = [name for name in CSV_COLUMNS[:-1] if name not in columns and name != 'id']
    if missing:
        raise SourceError(f'{path}: column {", ".join(missing)} is missing; expected frame,id,x,y,w,h[,moving]')
    rows: list[_Row] = []
    for number, cells in enumerate(reader, 2):
        try:
            rows.append(_fitting(_csv_row(cells)))
        except (ValueError, TypeError, OverflowError) as error:
            raise SourceError(f'{path}, line {number}: {error}') from None
    return Truth(np.array(rows, TRUTH_DTYPE), 'CSV', 'moving' in columns)


def _csv_row(cells: dict[str, str]) -> _Row:
    x, y, w, h = (float(cells[name]) for name in ('x', 'y', 'w', 'h'))
    return (int(float(cells['frame'])), int(float(cells.get('id') or 0)), x, y, w, h,
            int(float(cells.get('moving') or _MOVES)))
