"""detections.parquet: everything there is about each detection, one row each, for tables over many inputs."""

from __future__ import annotations

from array import array
from pathlib import Path
from typing import Any

import numpy as np

from motion_detect_ros.core.errors import BackendError, SourceError
from motion_detect_ros.core.types import DETECTION_DTYPE
from motion_detect_ros.results.detection_writer import FrameDetections
from motion_detect_ros.results.files import PARQUET_NAME
from motion_detect_ros.results.metrics import boxes_of
from motion_detect_ros.sources.part_file import PartFile

#: Rows of a row group: what is kept in memory, some hundred kilobytes.
GROUP_ROWS = 4096
#: Fields of a record that follow the columns of detections.csv, in their own order.
_BOX, _MORE = ('u', 'v', 'width', 'height'), ('score', 'vel_u', 'vel_v', 'ttc')
_REST = tuple(name for name in DETECTION_DTYPE.names or () if name not in (*_BOX, *_MORE, 'id'))


class ParquetDetections(PartFile):
    """The columns of detections.csv and all other fields of ``DETECTION_DTYPE``; ``input`` says what it is of.

    Left by an exception, the part is closed properly: a readable file of everything written so far. A part whose
    process was killed is none, as the index of the format stands at the end.
    """

    def __init__(self, folder: Path, source: str) -> None:
        """source: the column ``input``. Raises: BackendError without pyarrow, SourceError for an unwritable file."""
        self._arrow, parquet = _pyarrow()
        super().__init__(folder / PARQUET_NAME)
        self._source = source
        self._start_group()
        try:
            self._writer = parquet.ParquetWriter(str(self.part_path), self._group().schema, compression='zstd')
        except OSError as error:
            raise SourceError(f'{self.part_path}: cannot be written: {error.strerror or error}') from None

    def write(self, found: FrameDetections) -> None:
        """Add the rows of one frame."""
        count = len(found.records)
        self._frames.extend([found.frame] * count)
        self._stamps_ns.extend([found.stamp_ns] * count)
        self._records += found.records.tobytes()
        if len(self._frames) >= GROUP_ROWS:
            self._write_group()

    def finish_part(self) -> None:
        """Write the rows that wait and close the file under its part name."""
        try:
            self._write_group()
        finally:
            self._writer.close()

    def _start_group(self) -> None:
        self._frames, self._stamps_ns, self._records = array('q'), array('q'), bytearray()

    def _write_group(self) -> None:
        if self._frames:
            self._writer.write_table(self._group())
            self._start_group()

    def _group(self) -> Any:
        """pyarrow.Table of the rows that wait."""
        records = np.frombuffer(bytes(self._records), DETECTION_DTYPE)
        sources = self._arrow.DictionaryArray.from_arrays(np.zeros(len(records), np.int32), [self._source])
        columns = {
            'input': sources, 'frame': np.array(self._frames, np.int64),
            'stamp_ns': np.array(self._stamps_ns, np.int64), 'id': np.ascontiguousarray(records['id']),
            **dict(zip('xywh', boxes_of(records).T, strict=True)),
            **{name: np.ascontiguousarray(records[name]) for name in (*_MORE, *_REST)}}
        return self._arrow.table(columns)


def _pyarrow() -> tuple[Any, Any]:
    try:
        import pyarrow
        import pyarrow.parquet
    except ImportError:
        raise BackendError('format parquet: expected the package pyarrow; pip install pyarrow') from None
    return pyarrow, pyarrow.parquet
