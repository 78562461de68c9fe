"""detections.csv read back, and which frames of its source count."""

from __future__ import annotations

import csv
import json
import operator
from collections import defaultdict
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from motion_detect_ros.core.errors import SourceError
from motion_detect_ros.core.types import DoubleArray, RecordArray, empty_detections
from motion_detect_ros.results.files import CSV_NAME, FRAMES_NAME, SUMMARY_NAME
from motion_detect_ros.results.summary import takes_part
from motion_detect_ros.sources.truth import check_place, finite_box, whole_number

_BOX_COLUMNS = ('frame', 'x', 'y', 'w', 'h')


@dataclass(frozen=True)
class Found:
    """Detections by frame: ``boxes`` (N, 4) float64 x, y, w, h in pixels; ``ids`` (N,), -1 where the file has none."""

    boxes: Mapping[int, DoubleArray]
    ids: Mapping[int, Sequence[int]]

    def records(self) -> dict[int, RecordArray]:
        """Boxes and ids as ``DETECTION_DTYPE``. Raises: SourceError where there are no ids."""
        return {frame: _records(boxes, self.ids[frame]) for frame, boxes in self.boxes.items()}


def read_found(path: Path) -> Found:
    """Boxes and ids of a CSV with a header that names at least frame, x, y, w, h. Raises: SourceError."""
    rows: defaultdict[int, list[list[float]]] = defaultdict(list)
    ids: defaultdict[int, list[int]] = defaultdict(list)
    try:
        with path.open(newline='', encoding='utf-8-sig') as stream:
            reader = csv.DictReader(stream, skipinitialspace=True)
            missing = [name for name in _BOX_COLUMNS if name not in (reader.fieldnames or [])]
            if missing:
                raise SourceError(f'{path}: column {", ".join(missing)} is missing; expected frame,x,y,w,h')
            for cells in reader:
                frame = whole_number(cells['frame'], 'frame')
                box = finite_box([cells[name] for name in _BOX_COLUMNS[1:]])
                check_place(frame, box[2], box[3])
                rows[frame].append(box)
                ids[frame].append(whole_number(cells.get('id') or '-1', 'id'))
    except OSError as error:
        raise SourceError(f'{path}: detections cannot be read: {error.strerror}') from None
    except UnicodeDecodeError:
        raise SourceError(f'{path}: expected a CSV of detections, frame,x,y,w,h, got bytes that are no text') from None
    except (ValueError, TypeError, OverflowError) as error:
        raise SourceError(f'{path}, line {reader.line_num}: {error}') from None
    except csv.Error as error:  # the line is not counted yet
        raise SourceError(f'{path}, line {reader.line_num + 1}: {error}') from None
    return Found({frame: np.array(boxes, np.float64) for frame, boxes in rows.items()}, dict(ids))


def replayed_frames(detections: Path) -> int | None:
    """Frames of the source that ``detections`` are of, unreadable and left-out ones included; None without a summary.

    Raises: SourceError where the summary has no count.
    """
    content = _summary(detections)
    if content is None:
        return None
    try:
        return operator.index(content['source_frames'])
    except (KeyError, TypeError) as error:
        found = f'{type(error).__name__} {error}'
        path = detections.with_name(SUMMARY_NAME)
        raise SourceError(f'{path}: expected the count source_frames, got {found}') from None


def replayed_input(detections: Path) -> str | None:
    """The path of what ``detections`` are of; None without a summary that says so. Raises: SourceError."""
    content = _summary(detections)
    source = content.get('input') if isinstance(content, dict) else None
    return source if isinstance(source, str) else None


def window_frames(detections: Path) -> frozenset[int] | None:
    """The frames that were processed, where a replay took part of its source only; None where it took all, or was live
    and has no list of them.

    Raises: SourceError where frames.csv cannot be read.
    """
    content = _summary(detections)
    if not isinstance(content, dict) or content.get('live') is True or not takes_part(content):
        return None
    path = detections.with_name(FRAMES_NAME)
    try:
        with path.open(newline='', encoding='utf-8-sig') as stream:
            return frozenset(int(row['frame']) for row in csv.DictReader(stream))
    except OSError as error:
        raise SourceError(f'{path}: expected the frames of the replay: {error.strerror}') from None
    except (ValueError, KeyError, TypeError, csv.Error) as error:
        raise SourceError(f'{path}: expected a column frame of numbers, got {type(error).__name__} {error}') from None


def _summary(detections: Path) -> Any:
    """What summary.json beside detections.csv holds; None where there is none."""
    path = detections.with_name(SUMMARY_NAME)
    if detections.name != CSV_NAME or not path.is_file():
        return None
    try:
        return json.loads(path.read_text(encoding='utf-8'))
    except (OSError, ValueError, RecursionError) as error:
        found = f'{type(error).__name__} {error}'
        raise SourceError(f'{path}: expected the count source_frames, got {found}') from None


def _records(boxes: DoubleArray, ids: Sequence[int]) -> RecordArray:
    if min(ids, default=0) < 0:
        raise SourceError('detections: expected a column id, found none')
    records = empty_detections(len(boxes))
    limit = 1 + int(np.iinfo(records['id'].dtype).max)
    if max(ids, default=0) >= limit:
        raise SourceError(f'detections: expected ids below {limit}, got {max(ids)}')
    records['id'], records['width'], records['height'] = ids, boxes[:, 2], boxes[:, 3]
    records['u'], records['v'] = boxes[:, 0] + boxes[:, 2] / 2, boxes[:, 1] + boxes[:, 3] / 2
    return records
