"""Searches settings on one part of what was recorded and judges them on another, which was not looked at before."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from motion_detect_ros.core.config import PipelineConfig
from motion_detect_ros.core.errors import SourceError
from motion_detect_ros.core.settings import settings
from motion_detect_ros.core.types import BoolArray
from motion_detect_ros.results.bootstrap import Bootstrap, f1_of, resampled_f1
from motion_detect_ros.results.metrics import CountArray
from motion_detect_ros.tuning.objective import Objective, mean_gain
from motion_detect_ros.tuning.recording import Recording
from motion_detect_ros.tuning.space import Dimension, changed
from motion_detect_ros.tuning.split import BLOCKS, describe, split_frames
from motion_detect_ros.tuning.study import Study, Trial

#: Blocks of fewer frames say nothing.
MIN_FRAMES = 3 * BLOCKS


@dataclass(frozen=True)
class Verdict:
    """What the best values are worth. ``searched_gain``: of F1, on what they were chosen by; ``held_out_gain``: on what
    they were not, with its ``interval``; ``start_f1``, ``candidate_f1``: on what was held out.
    """

    candidate: PipelineConfig
    values: Mapping[str, float]
    searched_gain: float
    start_f1: float
    candidate_f1: float
    interval: tuple[float, float]

    @property
    def held_out_gain(self) -> float:
        """Of the mean F1."""
        return self.candidate_f1 - self.start_f1

    @property
    def shown(self) -> bool:
        """Whether there is a gain at all: the interval of the one held out lies over 0."""
        return self.interval[0] > 0.0


class Tuner:
    """One search. The start is measured when it is made, on everything."""

    def __init__(
        self, recordings: Sequence[Recording], objective: Objective, start: PipelineConfig,
        dimensions: Sequence[Dimension], seed: int,
    ) -> None:
        """Raises: SourceError for a recording that cannot be read, or is too short to hold out a part of it."""
        self._recordings, self._objective, self._start = recordings, objective, start
        self._names = [one.name for one in dimensions]
        self._before = [objective.measure(recording, start) for recording in recordings]
        for recording, counts in zip(recordings, self._before, strict=True):
            if len(counts) < MIN_FRAMES:
                raise SourceError(f'{recording.path}: expected {MIN_FRAMES} frames or more without the warm-up, '
                                  f'got {len(counts)}')
        self._splits = split_frames([len(counts) for counts in self._before], seed)
        # Where whole recordings are held out, the verdict is to hold for others too.
        self._plan = Bootstrap(seed=seed, draws_clips=any(split.held_out.all() for split in self._splits))

    @property
    def held_out(self) -> str:
        """What is held out, for people."""
        return describe(self._splits)

    @property
    def meaning(self) -> str:
        """What the interval says, for people."""
        return self._plan.meaning(sum(bool(split.held_out.any()) for split in self._splits))

    @property
    def caution(self) -> str:
        """What speaks against the interval; empty where nothing does."""
        held_out = [int(split.held_out.sum()) for split in self._splits]
        return self._plan.caution([frames for frames in held_out if frames])

    def start_values(self) -> dict[str, float]:
        """The searched settings at the start."""
        found = {name: value for name, value, _ in settings(self._start)}
        return {name: float(found[name]) for name in self._names}

    def search(self, study: Study, trials: int) -> Iterator[Trial]:
        """Run the study up to so many trials; yields each."""
        study.note_start(self.start_values())
        yield from study.run(self._searched_gain, trials)

    def judge(self, best: Trial) -> Verdict:
        """The best values on what was held out."""
        candidate = changed(self._start, best.values)
        pairs = self._pairs(candidate, [split.held_out for split in self._splits])
        f1 = np.mean([f1_of(pair.sum(axis=1)) for pair in pairs], axis=0)
        drawn = resampled_f1(pairs, self._plan)
        return Verdict(candidate, best.values, best.gain, float(f1[0]), float(f1[1]),
                       self._plan.interval(drawn[:, 1] - drawn[:, 0]))

    def _searched_gain(self, values: Mapping[str, float]) -> float:
        return mean_gain(self._pairs(changed(self._start, values), [split.searched for split in self._splits]))

    def _pairs(self, config: PipelineConfig, parts: Sequence[BoolArray]) -> list[CountArray]:
        """Start and candidate side by side on a part of each recording; those without such a part are not run."""
        return [self._objective.paired(before[part], self._objective.measure(recording, config)[part])
                for recording, before, part in zip(self._recordings, self._before, parts, strict=True) if part.any()]
