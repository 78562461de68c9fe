"""Detection quality: boxes against boxes, frame by frame.

A prediction matches a wanted truth box one to one, best overlap first, where their intersection over union (IoU)
reaches a threshold (greedy form of the matching in Everingham et al., "The PASCAL VOC Challenge", IJCV 2010).
Predictions that match nothing and lie on a box that counts neither way are dropped.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from motion_detect_ros.core.geometry.boxes import shared_areas
from motion_detect_ros.core.types import BoolArray, DoubleArray, RecordArray

#: A prediction with this share of its area inside an ignored box is not counted.
_INSIDE_IGNORED = 0.5
#: Keeps the division of empty areas finite, pixels^2.
_TINY_AREA = 1e-9

CountArray = npt.NDArray[np.int64]
NO_BOXES: DoubleArray = np.empty((0, 4))

MOVING_ONLY = (1,)
MOVING_AND_STANDING = (0, 1)
IGNORED = -1
#: What is wanted: moving objects only, or every labelled object.
COUNTINGS: Mapping[str, tuple[int, ...]] = {'moving': MOVING_ONLY, 'all': MOVING_AND_STANDING}


@dataclass(frozen=True)
class Score:
    """Counts over all frames of a sequence."""

    true_positives: int
    false_positives: int
    wanted: int
    frames: int

    @classmethod
    def of(cls, counts: CountArray) -> Score:
        """counts: (F, 3) of ``frame_counts``."""
        hits, false, wanted = counts.sum(axis=0).tolist() if len(counts) else (0, 0, 0)
        return cls(hits, false, wanted, len(counts))

    @property
    def precision(self) -> float:
        """Share of the predictions that are right; 0 without predictions."""
        return self.true_positives / max(self.true_positives + self.false_positives, 1)

    @property
    def recall(self) -> float:
        """Share of the wanted boxes that were found; 0 without wanted boxes."""
        return self.true_positives / max(self.wanted, 1)

    @property
    def f1(self) -> float:
        """Harmonic mean of precision and recall."""
        total = self.precision + self.recall
        return 2 * self.precision * self.recall / total if total else 0.0

    @property
    def false_per_frame(self) -> float:
        """False predictions a frame."""
        return self.false_positives / max(self.frames, 1)


def overlaps(a: DoubleArray, b: DoubleArray) -> tuple[DoubleArray, DoubleArray]:
    """IoU of every pair, and the share of each ``a`` inside each ``b``.

    a: (N, 4), b: (M, 4) float64, boxes as x, y, width, height in pixels. Returns two (N, M) arrays.
    """
    shared = shared_areas((a[:, :2], a[:, :2] + a[:, 2:]), (b[:, :2], b[:, :2] + b[:, 2:]))
    area_a, area_b = a[:, 2] * a[:, 3], b[:, 2] * b[:, 3]
    union = area_a[:, None] + area_b[None] - shared
    return shared / np.maximum(union, _TINY_AREA), shared / np.maximum(area_a[:, None], _TINY_AREA)


def match_pairs(predicted: DoubleArray, wanted: DoubleArray, iou_threshold: float) -> npt.NDArray[np.int64]:
    """(K, 2) rows (prediction, wanted box) of (N, 4) and (M, 4) boxes matched greedily, best IoU first."""
    iou, _ = overlaps(predicted, wanted)
    rows, columns = np.nonzero(iou >= iou_threshold)
    matched, taken, pairs = np.zeros(len(predicted), bool), np.zeros(len(wanted), bool), []
    for best in np.argsort(-iou[rows, columns], kind='stable'):
        row, column = rows[best], columns[best]
        if not matched[row] and not taken[column]:
            matched[row] = taken[column] = True
            pairs.append((row, column))
    return np.array(pairs, np.int64).reshape(-1, 2)


def match(predicted: DoubleArray, wanted: DoubleArray, iou_threshold: float) -> BoolArray:
    """(N,) bool: which of the (N, 4) predictions match one of the (M, 4) wanted boxes, greedily, best IoU first."""
    matched = np.zeros(len(predicted), bool)
    matched[match_pairs(predicted, wanted, iou_threshold)[:, 0]] = True
    return matched


@dataclass(frozen=True)
class FrameVerdict:
    """One frame judged. ``hit``, ``ignored``: (N,) bool of the predictions, neither means false; ``wanted``: (M,) the
    truth records that were wanted; ``found``: (M,) bool, which of them were hit.
    """

    hit: BoolArray
    ignored: BoolArray
    wanted: RecordArray
    found: BoolArray

    @property
    def errors(self) -> int:
        """False predictions and missed boxes."""
        return int((~self.hit & ~self.ignored).sum() + (~self.found).sum())


def judge_frame(
    here: RecordArray, predicted: DoubleArray, iou_threshold: float, wanted: Sequence[int] = MOVING_ONLY,
) -> FrameVerdict:
    """What became of each box of one frame. here: ``TRUTH_DTYPE`` of the frame; predicted: (N, 4) x, y, w, h."""
    goal = here[np.isin(here['moving'], wanted)]
    pairs = match_pairs(predicted, boxes_of_truth(goal), iou_threshold)
    hit, found = np.zeros(len(predicted), bool), np.zeros(len(goal), bool)
    hit[pairs[:, 0]] = found[pairs[:, 1]] = True
    ignored = _ignored(predicted, boxes_of_truth(here[here['moving'] == IGNORED]), iou_threshold) & ~hit
    return FrameVerdict(hit, ignored, goal, found)


def score_boxes(
    truth: RecordArray, predictions: Mapping[int, DoubleArray], iou_threshold: float,
    wanted: Sequence[int] = MOVING_ONLY, skip: int = 0, frames: int | None = None,
) -> Score:
    """Count hits and misses from frame ``skip`` to the last one.

    truth: ``TRUTH_DTYPE``; predictions: (N, 4) boxes x, y, w, h by frame; wanted: values of ``moving`` to be found,
    those with ``moving`` = -1 count neither way. Standing objects are false where only movers are wanted.
    frames: how many the sequence has, the skipped ones included; unless given, up to the last truth or prediction.
    """
    last = (frame_count(truth, predictions) if frames is None else frames) - 1
    return Score.of(frame_counts(truth, predictions, iou_threshold, wanted, range(skip, last + 1)))


def frame_counts(
    truth: RecordArray, predictions: Mapping[int, DoubleArray], iou_threshold: float, wanted: Sequence[int],
    frames: Sequence[int],
) -> CountArray:
    """(F, 3) hits, false predictions and wanted boxes of each of ``frames``; the rest as ``score_boxes``."""
    counts, labelled = np.zeros((len(frames), 3), np.int64), by_frame(truth)
    for row, frame in zip(counts, frames, strict=True):
        if frame not in labelled and frame not in predictions:
            continue
        here = labelled.get(frame, truth[:0])
        verdict = judge_frame(here, predictions.get(frame, NO_BOXES), iou_threshold, wanted)
        row[:] = verdict.hit.sum(), (~verdict.hit & ~verdict.ignored).sum(), len(verdict.wanted)
    return counts


def by_frame(truth: RecordArray) -> dict[int, RecordArray]:
    """The records of each frame that has some, in their order."""
    ordered = truth[np.argsort(truth['frame'], kind='stable')]
    frames, starts = np.unique(ordered['frame'], return_index=True)
    return dict(zip(frames.tolist(), np.split(ordered, starts[1:]), strict=False))  # of nothing one empty part


def frame_count(truth: RecordArray, predictions: Iterable[int]) -> int:
    """Frames up to the last one with truth, or in ``predictions``."""
    return 1 + max(int(truth['frame'].max(initial=-1)), max(predictions, default=-1))


def boxes_of_truth(truth: RecordArray) -> DoubleArray:
    """(N, 4) float64 x, y, width, height, pixels, of records with fields x, y, w, h, as those of ``TRUTH_DTYPE``."""
    return np.stack([truth[name] for name in ('x', 'y', 'w', 'h')], axis=-1).astype(np.float64)


def boxes_of(records: RecordArray) -> DoubleArray:
    """(N, 4) float64 x, y, width, height, pixels, of ``DETECTION_DTYPE`` records; x, y is the top left corner."""
    u, v, width, height = (records[name].astype(np.float64) for name in ('u', 'v', 'width', 'height'))
    return np.stack([u - width / 2, v - height / 2, width, height], axis=-1)


def _ignored(predicted: DoubleArray, ignored: DoubleArray, iou_threshold: float) -> BoolArray:
    """(N,) bool: which predictions overlap an ignored box enough, or lie in it with half of their area."""
    if not len(predicted) or not len(ignored):
        return np.zeros(len(predicted), bool)
    iou, inside = overlaps(predicted, ignored)
    swallowed: BoolArray = (iou.max(1) >= iou_threshold) | (inside.max(1) >= _INSIDE_IGNORED)
    return swallowed
