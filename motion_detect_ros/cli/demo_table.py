"""What the demo measured, as a table for people."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass

import numpy as np

from motion_detect_ros.core.types import RecordArray
from motion_detect_ros.results.evaluation import WARM_UP_FRAMES
from motion_detect_ros.results.metrics import IGNORED, MOVING_ONLY, Score, boxes_of, frame_counts
from motion_detect_ros.results.summary import Percentiles

IOUS = (0.3, 0.5)
#: Objects of less area are "small" in the COCO evaluation (Lin et al., ECCV 2014), pixels^2.
SMALL_AREA_PX2 = 32 ** 2


@dataclass(frozen=True)
class Run:
    """The detections of a sequence of images.

    stamps_ns: of the images, in order. records: ``DETECTION_DTYPE`` by frame index, an entry for every image that
    got a message. messages: detections messages received. times_ms: per image with a message, from image to detections
    (live, NaN where unknown) or compute time (in process). left_out: frame indices that the settings leave out.
    """

    stamps_ns: tuple[int, ...]
    records: Mapping[int, RecordArray]
    messages: int
    times_ms: tuple[float, ...]
    left_out: frozenset[int] = frozenset()

    @property
    def wanted(self) -> tuple[int, ...]:
        """Frame indices of the images that are to get a detections message."""
        return tuple(frame for frame in range(len(self.stamps_ns)) if frame not in self.left_out)

    @property
    def unanswered(self) -> int:
        """Images that got no detections message and were to get one."""
        return len(self.wanted) - len(self.records)


@dataclass(frozen=True)
class ScoreRow:
    """``what`` was wanted, at which IoU, and how it went."""

    what: str
    iou: float
    score: Score


def without_small(truth: RecordArray) -> RecordArray:
    """A copy of ``TRUTH_DTYPE`` records in which small objects (COCO: under 32 x 32 pixels) count neither way."""
    large = truth.copy()
    large['moving'][truth['w'] * truth['h'] < SMALL_AREA_PX2] = IGNORED
    return large


def score_rows(truth: RecordArray, run: Run) -> list[ScoreRow]:
    """Moving objects only, of all sizes and without the small ones; the first frames, which confirm, and those that the
    settings leave out not counted.
    """
    boxes = {frame: boxes_of(records) for frame, records in run.records.items()}
    frames = [frame for frame in run.wanted if frame >= WARM_UP_FRAMES]
    return [ScoreRow(what, iou, Score.of(frame_counts(wanted, boxes, iou, MOVING_ONLY, frames)))
            for what, wanted in (('all', truth), ('32 x 32 px and larger', without_small(truth))) for iou in IOUS]


def largest_difference(a: Run, b: Run) -> float:
    """Largest difference of any box corner (pixels) between two runs; infinite where they hold other objects."""
    if set(a.records) != set(b.records):
        return float('inf')
    worst = 0.0
    for frame, records in a.records.items():
        mine, other = np.sort(records, order='id'), np.sort(b.records[frame], order='id')
        if mine['id'].tolist() != other['id'].tolist():
            return float('inf')
        worst = max(worst, float(np.abs(boxes_of(mine) - boxes_of(other)).max(initial=0.0)))
    return worst


def table(truth: RecordArray, run: Run, offline: Run | None = None) -> Iterator[str]:
    """The lines of the table. offline: the same images in one process, None where ``run`` is that already."""
    known = [time for time in run.times_ms if np.isfinite(time)]
    times, clock = Percentiles.of(known), 'image to detections' if offline else 'compute time a frame'
    objects = {int(ident) for records in run.records.values() for ident in records['id']}
    yield f'  {"images in":<28}{len(run.stamps_ns)}'
    if run.left_out:
        yield f'  {"left out by the settings":<28}{len(run.left_out)}'
    yield f'  {"detections messages out":<28}{run.messages}'
    yield f'  {"images dropped":<28}{run.unanswered}'
    yield f'  {"boxes, objects":<28}{sum(map(len, run.records.values()))}, {len(objects)}'
    yield f'  {clock:<28}p50 {times.p50:.1f} ms, p95 {times.p95:.1f} ms, {len(known)} images'
    if offline is not None:
        alone = Percentiles.of(list(offline.times_ms))
        yield f'  {"the same in one process":<28}p50 {alone.p50:.1f} ms, p95 {alone.p95:.1f} ms'
        yield f'  {"largest difference to it":<28}{largest_difference(run, offline):.2g} px'
    yield ''
    yield f'  {"moving objects":<24}{"IoU":>5}{"precision":>11}{"recall":>8}{"F1":>7}{"false a frame":>15}{"wanted":>8}'
    for row in score_rows(truth, run):
        yield (f'  {row.what:<24}{row.iou:>5.1f}{row.score.precision:>11.3f}{row.score.recall:>8.3f}'
               f'{row.score.f1:>7.3f}{row.score.false_per_frame:>15.2f}{row.score.wanted:>8}')
