"""How good settings are on a recording: F1 against truth, or agreement with the same flight backwards."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Protocol

import numpy as np

from motion_detect_ros.core.config import PipelineConfig
from motion_detect_ros.core.errors import SourceError
from motion_detect_ros.results.bootstrap import f1_of
from motion_detect_ros.results.evaluation import WARM_UP_FRAMES
from motion_detect_ros.results.metrics import COUNTINGS, CountArray, frame_counts
from motion_detect_ros.sources.numbered_pictures import truth_of_input
from motion_detect_ros.tuning.agreement import against_each_other, agreement
from motion_detect_ros.tuning.recording import Clip, Recording, detect, load


class Objective(Protocol):
    """Counts of every frame under some settings, and two such counts side by side."""

    def measure(self, recording: Recording, config: PipelineConfig) -> CountArray:
        """(F, K) counts of the frames of a recording that count. Raises: SourceError."""

    def paired(self, start: CountArray, candidate: CountArray) -> CountArray:
        """(2, F, 3) hits, false and wanted of both, from (F, K) each."""


class TruthObjective:
    """F1 against truth at one IoU. counting: a key of ``COUNTINGS``."""

    def __init__(self, counting: str, iou: float) -> None:
        self._wanted, self._iou = COUNTINGS[counting], iou

    def measure(self, recording: Recording, config: PipelineConfig) -> CountArray:
        """(F, 3) of ``frame_counts``. Raises: SourceError where the recording or its truth cannot be read."""
        if recording.truth is None:
            raise SourceError(f'{recording.path}: expected truth, got none')
        clip = load(recording, config)
        frames = [picture.index for picture in clip.pictures][WARM_UP_FRAMES:]
        truth = truth_of_input(recording.truth, recording.path).boxes
        return frame_counts(truth, detect(clip, config).boxes, self._iou, self._wanted, frames)

    def paired(self, start: CountArray, candidate: CountArray) -> CountArray:
        """As they are."""
        return np.stack([start, candidate])


class AgreementObjective:
    """Agreement of the flight forwards with the same flight backwards; see ``tuning.agreement``."""

    def __init__(self, iou: float) -> None:
        self._iou = iou

    def measure(self, recording: Recording, config: PipelineConfig) -> CountArray:
        """(F, 2) of ``agreement``; neither run counts while it warms up. Raises: SourceError."""
        clip = load(recording, config)
        frames = [picture.index for picture in clip.pictures][WARM_UP_FRAMES:-WARM_UP_FRAMES]
        return agreement(detect(clip, config), detect(Clip.reversed(clip), config), frames, self._iou)

    def paired(self, start: CountArray, candidate: CountArray) -> CountArray:
        """Each held to what the better one agrees on."""
        return against_each_other(start, candidate)


def mean_gain(pairs: Sequence[CountArray]) -> float:
    """Mean over recordings of the F1 of the second less that of the first, of (2, F, 3) counts each."""
    return float(np.mean([np.diff(f1_of(pair.sum(axis=1)))[0] for pair in pairs]))
