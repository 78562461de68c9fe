"""A replay against ground truth: scores, errors by frame, and the objects behind most of the errors."""

from __future__ import annotations

from collections import defaultdict
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from motion_detect_ros.core.types import BoolArray, DoubleArray
from motion_detect_ros.report.replayed import Replayed
from motion_detect_ros.results.evaluation import counted_frames
from motion_detect_ros.results.metrics import (
    COUNTINGS,
    Score,
    boxes_of_truth,
    frame_counts,
    judge_frame,
)
from motion_detect_ros.sources.numbered_pictures import truth_of_input
from motion_detect_ros.sources.truth import Truth

#: What counts as found in the pictures and the plot of errors.
PICTURE_IOU = 0.3
IOUS = (0.3, 0.5)
#: As many misses and as many false boxes are shown as pictures.
MAX_PICTURES = 18


@dataclass(frozen=True)
class Mistake:
    """One object that was missed (``missed``) or reported although nothing wanted is there, in ``count`` of its
    ``frames`` counted frames; ``box`` (x, y, w, h, px) is that of the frame ``frame`` where it is largest.
    """

    missed: bool
    identity: int
    count: int
    frames: int
    frame: int
    box: tuple[float, float, float, float]


@dataclass(frozen=True)
class Judged:
    """``scores``: by counting and IoU; ``misses``, ``false_boxes``: (N,) counts of each processed frame, 0 in the
    frames not counted; ``found``, ``counts``: (M,) bool, which truth records were found, and count, of ``truth.boxes``.
    """

    path: Path
    truth: Truth
    scores: dict[tuple[str, float], Score]
    misses: DoubleArray
    false_boxes: DoubleArray
    found: BoolArray
    counts: BoolArray
    mistakes: tuple[Mistake, ...]

    @property
    def main(self) -> Score:
        """Moving objects at the first IoU."""
        return self.scores['moving', IOUS[0]]


def judge(replayed: Replayed, path: Path, source: str | None = None) -> Judged:
    """Match the boxes of a replay with the truth in a file, frame by frame.

    source: where the input is now, when it was moved: labels may go by the names of its pictures. Scores are those of
    ``evaluate``; of an interrupted replay only the frames count that it came to.
    Raises: SourceError for truth that cannot be read.
    """
    truth = truth_of_input(path, source or replayed.summary.input)
    boxes = truth.boxes[np.isin(truth.boxes['frame'], replayed.frames['frame'])]
    boxes = boxes[np.argsort(boxes['frame'], kind='stable')]
    by_frame = {frame: boxes_of_truth(replayed.of_frame(frame)) for frame in replayed.frames['frame'].tolist()}
    counted = counted_frames(replayed.summary.source_frames, [frozenset(by_frame)] if replayed.in_part else [])
    scores = {(name, iou): Score.of(frame_counts(truth.boxes, by_frame, iou, wanted, counted))
              for name, wanted in COUNTINGS.items() for iou in IOUS}
    counts = np.isin([*by_frame], counted)
    found = np.zeros(len(boxes), bool)
    misses, false_boxes = np.zeros(len(by_frame)), np.zeros(len(by_frame))
    tally = _Tally()
    for row, (frame, predicted) in enumerate(by_frame.items()):
        here = np.arange(*np.searchsorted(boxes['frame'], (frame, frame + 1)))
        verdict = judge_frame(boxes[here], predicted, PICTURE_IOU)
        found[here[boxes['moving'][here] == 1]] = verdict.found
        if not counts[row]:
            continue
        wrong = ~verdict.hit & ~verdict.ignored
        misses[row], false_boxes[row] = (~verdict.found).sum(), wrong.sum()
        tally.add(True, frame, verdict.wanted['id'], ~verdict.found, boxes_of_truth(verdict.wanted))
        tally.add(False, frame, replayed.of_frame(frame)['id'], wrong, predicted)
    wanted_ones = (boxes['moving'] == 1) & np.isin(boxes['frame'], counted)
    return Judged(path, replace(truth, boxes=boxes), scores, misses, false_boxes, found, wanted_ones, tally.worst())


class _Tally:
    """Errors by object."""

    def __init__(self) -> None:
        self._seen: defaultdict[tuple[bool, int], int] = defaultdict(int)
        self._errors: defaultdict[tuple[bool, int], list[tuple[float, int, tuple[float, ...]]]] = defaultdict(list)

    def add(self, missed: bool, frame: int, ids: np.ndarray, wrong: BoolArray, boxes: DoubleArray) -> None:
        for identity, is_wrong, box in zip(ids.tolist(), wrong.tolist(), boxes.tolist(), strict=True):
            self._seen[missed, identity] += 1
            if is_wrong:
                self._errors[missed, identity].append((box[2] * box[3], frame, tuple(box)))

    def worst(self) -> tuple[Mistake, ...]:
        """Of each kind those with the most errors."""
        found = []
        for (missed, identity), errors in self._errors.items():
            _, frame, (x, y, w, h) = max(errors)
            found.append(Mistake(missed, identity, len(errors), self._seen[missed, identity], frame, (x, y, w, h)))
        found.sort(key=lambda each: (-each.count, each.identity))
        return tuple(each for kind in (True, False)
                     for each in [each for each in found if each.missed is kind][:MAX_PICTURES])
