"""What a replay leaves behind: detections.csv, detections.mcap, summary.json."""

from __future__ import annotations

import json
from collections import Counter
from dataclasses import asdict, dataclass, field
from pathlib import Path
from types import TracebackType
from typing import Self

import numpy as np

from motion_detect_ros.core.types import RecordArray, Result, StageTimes
from motion_detect_ros.sources.bags import PART_SUFFIX, BagWriter

CSV_NAME, BAG_NAME, SUMMARY_NAME = 'detections.csv', 'detections.mcap', 'summary.json'
CSV_HEADER = 'frame,stamp_ns,id,x,y,w,h,score,vel_u,vel_v,ttc'
OUTPUT_NAMES = CSV_NAME, BAG_NAME, SUMMARY_NAME
#: Small, so that a replay that is killed leaves what it did up to a few frames before.
BAG_CHUNK_BYTES = 2048

STAGES = ('preprocessing', 'ego_motion', 'optical_flow', 'clustering', 'total')


@dataclass(frozen=True)
class Percentiles:
    """Median and 95th percentile of a time, ms; NaN would be no JSON, so nothing measured is 0."""

    p50: float = 0.0
    p95: float = 0.0

    @classmethod
    def of(cls, times_ms: list[float]) -> Self:
        """Of a list of times in ms."""
        if not times_ms:
            return cls()
        p50, p95 = np.percentile(times_ms, (50, 95))
        return cls(round(float(p50), 3), round(float(p95), 3))


@dataclass(frozen=True)
class Summary:
    """One input's replay in numbers; the fields are those of summary.json.

    ``frames``: processed; ``misstamped_frames``: left out, as their stamps were seen already or late;
    ``source_frames``: of the source, those left out and unreadable ones included.
    """

    input: str
    version: str
    complete: bool
    damaged: str | None
    announced_frames: int | None
    frames: int
    bad_frames: int
    misstamped_frames: int
    source_frames: int
    detections: int
    objects: int
    ego_status: dict[str, int]
    image_size: tuple[int, int]
    calibrated: bool
    first_stamp_ns: int
    last_stamp_ns: int
    stage_ms: dict[str, Percentiles]
    decode_ms: Percentiles
    settings: dict[str, bool | int | float | str]


@dataclass
class Tally:
    """Counts and times as frames go by."""

    frames: int = 0
    bad_frames: int = 0
    misstamped_frames: int = 0
    source_frames: int = 0
    detections: int = 0
    ids: set[int] = field(default_factory=set)
    ego_status: Counter[str] = field(default_factory=Counter)
    times: list[StageTimes] = field(default_factory=list)
    decode_ms: list[float] = field(default_factory=list)
    stamps_ns: list[int] = field(default_factory=list)
    image_size: tuple[int, int] = (0, 0)

    def add(self, result: Result) -> None:
        """Count one processed frame."""
        self.frames += 1
        self.detections += len(result.detections)
        self.ids.update(result.detections['id'].tolist())
        self.ego_status[result.ego.status.name.lower()] += 1
        self.times.append(result.times_ms)
        self.stamps_ns.append(result.stamp_ns)
        self.image_size = result.flow.width, result.flow.height

    def stage_ms(self) -> dict[str, Percentiles]:
        """Percentiles of every stage."""
        return {stage: Percentiles.of([getattr(times, stage) for times in self.times]) for stage in STAGES}


class ReplayOutputs:
    """The CSV and the bag of one replay; use as a context manager.

    Both are written as ``.part`` and renamed when complete; left by an exception, the parts stay as they are,
    readable, with everything written so far.
    """

    def __init__(self, folder: Path) -> None:
        """Raises: SourceError where the folder cannot be written."""
        self.bag = BagWriter(folder / BAG_NAME, chunk_bytes=BAG_CHUNK_BYTES)
        self._folder = folder
        self._csv = (folder / (CSV_NAME + PART_SUFFIX)).open('w', encoding='ascii', newline='\n')
        self._csv.write(CSV_HEADER + '\n')

    def write(self, frame: int, stamp_ns: int, detections: RecordArray) -> None:
        """Add the detections of one frame: a message always, a row for each."""
        self.bag.write_detections(detections, stamp_ns)
        for record in detections:
            self._csv.write(csv_row(frame, stamp_ns, record) + '\n')
        self._csv.flush()

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None,
    ) -> None:
        self._csv.close()
        if kind is None:
            self.bag.close()
            (self._folder / (CSV_NAME + PART_SUFFIX)).replace(self._folder / CSV_NAME)
        else:
            self.bag.finish_part()


def csv_row(frame: int, stamp_ns: int, record: np.void | RecordArray) -> str:
    """One detection (``DETECTION_DTYPE``) as a line; x, y is the top left corner, pixels, 5 decimals."""
    width, height = float(record['width']), float(record['height'])
    numbers = (float(record['u']) - width / 2, float(record['v']) - height / 2, width, height, float(record['score']),
               float(record['vel_u']), float(record['vel_v']), float(record['ttc']))
    return f'{frame},{stamp_ns},{int(record["id"])},' + ','.join(f'{number:.5f}' for number in numbers)


def write_summary(folder: Path, summary: Summary) -> None:
    """Write summary.json, whole or not at all."""
    part = folder / (SUMMARY_NAME + PART_SUFFIX)
    part.write_text(json.dumps(asdict(summary), indent=2) + '\n', encoding='utf-8')
    part.replace(folder / SUMMARY_NAME)
