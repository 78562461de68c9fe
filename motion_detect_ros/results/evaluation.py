"""Detections against truth, clip by clip: what was found in which frames, and means over clips."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path

import numpy as np

from motion_detect_ros.core.errors import SourceError
from motion_detect_ros.core.types import RecordArray
from motion_detect_ros.results.bootstrap import Bootstrap, resampled_f1
from motion_detect_ros.results.found import Found, read_found, replayed_frames, replayed_input, window_frames
from motion_detect_ros.results.metrics import (
    COUNTINGS,
    NO_BOXES,
    CountArray,
    FrameVerdict,
    Score,
    by_frame,
    frame_count,
    frame_counts,
    judge_frame,
)
from motion_detect_ros.sources.numbered_pictures import truth_of_input
from motion_detect_ros.sources.truth import Truth

#: Frames at the start that are not counted: a detector that confirms over frames reports nothing there yet.
WARM_UP_FRAMES = 10
#: More are not counted: a wrong number in a file is no reason to take all memory.
MAX_FRAMES = 10**7


@dataclass(frozen=True)
class ClipEvaluation:
    """One clip: its truth, and what each run found. ``frames``: those counted; ``files``: detections.csv by run;
    ``late_labels``: those of frames after the end of a replay, which count nowhere.
    """

    name: str
    truth: Truth
    found: Mapping[str, Found]
    frames: Sequence[int]
    files: Mapping[str, Path]
    late_labels: int = 0

    @cached_property
    def _labelled(self) -> Mapping[int, RecordArray]:
        return by_frame(self.truth.boxes)

    def counts(self, run: str, counting: str, iou: float) -> CountArray:
        """(F, 3) of ``frame_counts``; counting: a key of ``COUNTINGS``."""
        return frame_counts(self.truth.boxes, self.found[run].boxes, iou, COUNTINGS[counting], self.frames)

    def verdict(self, run: str, counting: str, iou: float, frame: int) -> FrameVerdict:
        """What became of each box of one frame."""
        here = self._labelled.get(frame, self.truth.boxes[:0])
        return judge_frame(here, self.found[run].boxes.get(frame, NO_BOXES), iou, COUNTINGS[counting])


@dataclass(frozen=True)
class Figure:
    """One counting at one IoU: ``scores`` by clip and run, ``means`` of F1 by run, and intervals where asked for.

    ``intervals``: of the mean F1 by run; ``differences``: of each further run to the first, low and high.
    """

    counting: str
    iou: float
    scores: Mapping[str, Mapping[str, Score]]
    means: Mapping[str, float]
    intervals: Mapping[str, tuple[float, float]]
    differences: Mapping[str, tuple[float, float]]

    @property
    def name(self) -> str:
        """For instance ``moving@0.3``."""
        return f'{self.counting}@{self.iou:g}'


def evaluate_clip(
    name: str, truth_path: Path, files: Mapping[str, Path], skip: int = WARM_UP_FRAMES, last_frame: int | None = None,
) -> ClipEvaluation:
    """Read one clip. files: detections.csv by run; last_frame: last one counted of those that there are.

    All frames from ``skip`` on count: those of the replay where its summary lies beside the detections, of several the
    ones that all came to, without any those up to the last one with truth or detections; of a replay of part of its
    source those that all runs processed. Labels go by the names of the input's pictures where the summary says where
    these are.
    Raises: SourceError, also where no frame counts.
    """
    inputs = [source for file in files.values() if (source := replayed_input(file)) and Path(source).exists()]
    truth = truth_of_input(truth_path, inputs[0] if inputs else None)
    found = {run: read_found(file) for run, file in files.items()}
    ends = [end for file in files.values() if (end := replayed_frames(file)) is not None]
    wanted = math.inf if last_frame is None else 1 + last_frame
    if last_frame is not None:
        ends.append(1 + last_frame)
    total = min(ends) if ends else max(frame_count(truth.boxes, each.boxes) for each in found.values())
    late = int(((truth.boxes['frame'] >= total) & (truth.boxes['frame'] < wanted)).sum())
    windows = [window for file in files.values() if (window := window_frames(file)) is not None]
    frames = counted_frames(total, windows, skip)
    if not len(frames):
        there = len(counted_frames(total, windows, 0))
        raise SourceError(f'{next(iter(files.values()))}: expected more than {skip} frames (--skip), got {there}')
    return ClipEvaluation(name, truth, found, frames, files, late)


def counted_frames(
    total: int, windows: Sequence[frozenset[int]] = (), skip: int = WARM_UP_FRAMES,
) -> Sequence[int]:
    """The frames below ``total`` that count: all but the first ``skip``, or where runs processed only the frames of
    their windows, those of all windows but the first ``skip`` of them.

    Raises: SourceError for more than ``MAX_FRAMES``.
    """
    if windows:
        return [frame for frame in sorted(frozenset.intersection(*windows))[skip:] if frame < total]
    if total > MAX_FRAMES:
        raise SourceError(f'truth and detections: expected frame numbers below {MAX_FRAMES}, got {total - 1}')
    return range(skip, total)


def figure_of(clips: Sequence[ClipEvaluation], counting: str, iou: float, plan: Bootstrap | None = None) -> Figure:
    """One counting at one IoU over all clips and runs; with a plan also its intervals."""
    runs = list(clips[0].files)
    counts = {clip.name: np.stack([clip.counts(run, counting, iou) for run in runs]) for clip in clips}
    scores = {name: {run: Score.of(each) for run, each in zip(runs, of_runs, strict=True)}
              for name, of_runs in counts.items()}
    means = {run: float(np.mean([each[run].f1 for each in scores.values()])) for run in runs}
    if plan is None:
        return Figure(counting, iou, scores, means, {}, {})
    drawn = resampled_f1(list(counts.values()), plan)
    return Figure(
        counting, iou, scores, means, {run: plan.interval(drawn[:, number]) for number, run in enumerate(runs)},
        {run: plan.interval(drawn[:, number] - drawn[:, 0]) for number, run in enumerate(runs) if number})


def counting_of(truth: Truth) -> str:
    """What the countings mean for this truth, for people."""
    if truth.says_what_moves:
        return 'moving: only objects labelled as moving are wanted; all: standing ones too'
    return f'the {truth.form} does not say what moves: every labelled object is wanted, in both countings'
