"""A result folder read back: what the report is made of, in arrays."""

from __future__ import annotations

import csv
from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from functools import cached_property
from pathlib import Path

import numpy as np

from motion_detect_ros.core.errors import SourceError
from motion_detect_ros.core.types import NANOSECONDS, BoolArray, DoubleArray, RecordArray
from motion_detect_ros.results.files import CSV_NAME, FRAMES_NAME, TIMES_NAME
from motion_detect_ros.results.rows import TIMES_HEADER
from motion_detect_ros.results.summary import STAGES, Percentiles, Summary, read_summary, takes_part
from motion_detect_ros.sources.part_file import part_of

#: One row of detections.csv: frame, id, top left corner and size (px), score, velocity (px/s), time to contact (s).
BOX_DTYPE = np.dtype([
    ('frame', '<i8'), ('stamp_ns', '<i8'), ('id', '<i8'), ('x', '<f8'), ('y', '<f8'), ('w', '<f8'), ('h', '<f8'),
    ('score', '<f8'), ('vel_u', '<f8'), ('vel_v', '<f8'), ('ttc', '<f8')])
#: One row of frames.csv; the affine is NaN where there is no estimate.
FRAME_DTYPE = np.dtype([
    ('frame', '<i8'), ('stamp_ns', '<i8'), ('ego_status', 'U24'), ('m00', '<f8'), ('m01', '<f8'), ('m02', '<f8'),
    ('m10', '<f8'), ('m11', '<f8'), ('m12', '<f8')])
#: One row of times.csv, ms.
TIMES_DTYPE = np.dtype([(name, '<i8' if name == 'frame' else '<f8') for name in TIMES_HEADER.split(',')])

_BLOCK_ROWS = 10_000


@dataclass(frozen=True)
class Replayed:
    """``boxes``: ``BOX_DTYPE``, by frame; ``frames``: ``FRAME_DTYPE``, one for each processed frame; ``times``:
    ``TIMES_DTYPE``, one for each processed frame, empty where times.csv is missing.
    """

    folder: Path
    summary: Summary
    boxes: RecordArray
    frames: RecordArray
    times: RecordArray

    def seconds(self, frame: np.ndarray) -> DoubleArray:
        """Seconds from the first processed frame to those with these numbers.

        Where stamps go back, as after the clock of a recording was set, the next frame is ``interval_s`` later.
        """
        rows = np.searchsorted(self.frames['frame'], frame)
        return self._elapsed_s[np.minimum(rows, len(self._elapsed_s) - 1)]

    @cached_property
    def _elapsed_s(self) -> DoubleArray:
        steps = np.diff(self.frames['stamp_ns']) / NANOSECONDS
        return np.r_[0.0, np.cumsum(np.where(steps > 0, steps, self.interval_s))]

    @property
    def duration_s(self) -> float:
        """From the first to the last processed frame."""
        return float(self._elapsed_s[-1])

    @property
    def interval_s(self) -> float:
        """Median time from one processed frame to the next; 0 for fewer than two frames."""
        steps = np.diff(self.frames['stamp_ns'])
        forward = steps[steps > 0]
        return float(np.median(forward)) / NANOSECONDS if len(forward) else 0.0

    @property
    def in_part(self) -> bool:
        """Whether not all of the input was to be processed, or the replay did not come to its end."""
        return not self.summary.complete or takes_part(vars(self.summary))

    def of_frame(self, frame: int) -> RecordArray:
        """The boxes of one frame."""
        first, last = np.searchsorted(self.boxes['frame'], (frame, frame + 1))
        return self.boxes[first:last]

    def usable(self) -> BoolArray:
        """(N,) bool: which frames have an ego-motion estimate."""
        return np.isfinite(self.frames['m00'])


def read_replayed(folder: Path) -> Replayed:
    """Everything in the result folder of one replay, that of an interrupted one too.

    Raises: SourceError where summary.json, detections.csv or frames.csv is missing or is no such file.
    """
    summary = read_summary(folder)
    boxes, frames = _read(folder / CSV_NAME, BOX_DTYPE), _read(folder / FRAMES_NAME, FRAME_DTYPE)
    path = folder / TIMES_NAME
    times = _read(path, TIMES_DTYPE) if path.exists() or part_of(path).exists() else np.empty(0, TIMES_DTYPE)
    if (np.diff(boxes['frame']) < 0).any():
        boxes = boxes[np.argsort(boxes['frame'], kind='stable')]
    return Replayed(folder, _completed(summary, boxes, frames, times), boxes, frames, times)


def _completed(summary: Summary, boxes: RecordArray, frames: RecordArray, times: RecordArray) -> Summary:
    """That of a replay that was killed still says what it did when it began: the rows know better."""
    if summary.complete or summary.frames or not len(frames):
        return summary
    status, counts = np.unique(frames['ego_status'], return_counts=True)
    stages = {stage: Percentiles.of(times[stage].tolist()) for stage in STAGES}
    return replace(
        summary, frames=len(frames), source_frames=1 + int(frames['frame'].max()), detections=len(boxes),
        objects=len(np.unique(boxes['id'])), ego_status=dict(zip(status.tolist(), counts.tolist(), strict=True)),
        first_stamp_ns=int(frames['stamp_ns'][0]), last_stamp_ns=int(frames['stamp_ns'][-1]), stage_ms=stages,
        decode_ms=Percentiles.of(times['decode'].tolist()))


def _read(path: Path, dtype: np.dtype[np.void]) -> RecordArray:
    """Rows of a CSV with a header, or of its .part where that is all there is; the columns of ``dtype``."""
    found = path if path.exists() else part_of(path)
    try:
        with found.open(newline='', encoding='utf-8-sig') as stream:
            reader = csv.DictReader(stream)
            missing = [name for name in dtype.names or () if name not in (reader.fieldnames or ())]
            if missing:
                expected = ','.join(dtype.names or ())
                raise SourceError(f'{found}: column {", ".join(missing)} is missing; expected {expected}')
            return np.concatenate([np.empty(0, dtype), *_blocks(reader, dtype, whole=found == path)])
    except OSError as error:
        raise SourceError(f'{path}: expected a file of a replay: {error.strerror}') from None
    except (ValueError, TypeError, OverflowError) as error:
        raise SourceError(f'{found}, line {reader.line_num}: {error}') from None
    except csv.Error as error:  # the line is not counted yet
        raise SourceError(f'{found}, line {reader.line_num + 1}: {error}') from None


def _blocks(reader: csv.DictReader[str], dtype: np.dtype[np.void], whole: bool) -> Iterator[RecordArray]:
    """The rows in arrays of ``_BLOCK_ROWS``, as rows of Python objects take ten times as much; the last line of a file
    that is not ``whole`` may be cut off.
    """
    parsers = [(name, _PARSERS[dtype[name].kind]) for name in dtype.names or ()]
    rows = []
    for cells in reader:
        if not whole and None in cells.values():
            break
        rows.append(tuple(parse(cells[name]) for name, parse in parsers))
        if len(rows) == _BLOCK_ROWS:
            yield np.array(rows, dtype)
            rows = []
    yield np.array(rows, dtype)


_PARSERS: dict[str, Callable[[str], int | float | str]] = {
    'i': int, 'f': lambda text: float(text) if text else np.nan, 'U': str}
