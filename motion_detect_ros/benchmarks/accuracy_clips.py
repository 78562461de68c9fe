"""The clips that accuracy is measured on: what they are, and the detector run over them, in several processes."""

from __future__ import annotations

import json
import multiprocessing
from collections.abc import Callable, Iterator, Mapping, Sequence
from concurrent.futures import ProcessPoolExecutor
from dataclasses import dataclass
from itertools import islice
from pathlib import Path
from typing import Any, TypeVar

import cv2
import numpy as np

from motion_detect_ros.cli.progress import track
from motion_detect_ros.core.errors import SourceError
from motion_detect_ros.core.pipeline import MotionPipeline
from motion_detect_ros.core.settings import with_settings
from motion_detect_ros.core.types import DoubleArray, RecordArray, Result
from motion_detect_ros.presets import load_preset
from motion_detect_ros.results.metrics import COUNTINGS, Score, boxes_of, score_boxes
from motion_detect_ros.sources.frames import FrameSource
from motion_detect_ros.sources.opening import open_source
from motion_detect_ros.sources.truth import read_truth

Task = TypeVar('Task')
Outcome = TypeVar('Outcome')

#: Environment variable with the folder of the clips, and the folder where it is not set.
DATA_VARIABLE, DATA_DEFAULT = 'MOTION_DETECT_DATA', '../shared/data'
IOUS = (0.3, 0.5)
#: Frames at the start that are not counted; on clips shorter than SHORT_FRAMES only the second number.
WARM_UP_FRAMES, SHORT_WARM_UP_FRAMES, SHORT_FRAMES = 10, 2, 30


@dataclass(frozen=True)
class Clip:
    """One entry of clips.json. ``complete``: every moving object is labelled; ``limit``: first frames used, or all."""

    name: str
    frames: Path
    truth: Path
    fps: float
    preset: str
    complete: bool = True
    limit: int | None = None

    @property
    def family(self) -> str:
        """The data set it is from: its name up to the first underscore."""
        return self.name.split('_', maxsplit=1)[0]

    def source(self) -> FrameSource:
        """Its pictures, all of them. Raises: SourceError."""
        return open_source(str(self.frames), self.fps)

    def read_truth(self) -> RecordArray:
        """Its truth, up to ``limit``."""
        truth = read_truth(self.truth)
        return truth if self.limit is None else truth[truth['frame'] < self.limit]


@dataclass(frozen=True)
class ClipRun:
    """``detections``: ``DETECTION_DTYPE`` by frame; ``frame_ms``: median compute time, with ``--jobs`` busy cores."""

    clip: Clip
    detections: Mapping[int, RecordArray]
    frame_ms: float

    @property
    def frames(self) -> int:
        """How many the clip has; all are counted from ``skip`` on, labelled or not."""
        return 1 + max(self.detections, default=-1)

    @property
    def skip(self) -> int:
        """Frames at the start that are not counted."""
        return WARM_UP_FRAMES if len(self.detections) >= SHORT_FRAMES else SHORT_WARM_UP_FRAMES

    def boxes(self) -> dict[int, DoubleArray]:
        """(N, 4) x, y, w, h by frame, full-resolution pixels."""
        return {frame: boxes_of(records) for frame, records in self.detections.items()}

    def scores(self, counting: str = 'moving') -> tuple[Score, ...]:
        """One for each IoU of ``IOUS``; counting: a key of ``COUNTINGS``."""
        truth, boxes = self.clip.read_truth(), self.boxes()
        return tuple(score_boxes(truth, boxes, iou, COUNTINGS[counting], self.skip, self.frames) for iou in IOUS)


@dataclass(frozen=True)
class Job:
    """A clip and the settings (dotted names) to change in its preset."""

    clip: Clip
    changes: Mapping[str, Any]


def read_clips(data: Path, names: Sequence[str] = ()) -> list[Clip]:
    """The clips of a folder, all or those named. Raises: SourceError where ``clips.json`` or a name is missing."""
    index = data / 'clips.json'
    if not index.is_file():
        raise SourceError(f'{data}: expected a folder with clips.json; set {DATA_VARIABLE} or --data')
    entries = json.loads(index.read_text(encoding='utf-8'))
    unknown = [name for name in names if name not in entries]
    if unknown:
        raise SourceError(f'clips: expected some of {", ".join(entries)}, got {", ".join(unknown)}')
    return [Clip(name, data / entry['frames'], data / entry['gt'], float(entry['fps']), entry['preset'],
                 bool(entry.get('complete_gt', True)))
            for name, entry in entries.items() if not names or name in names]


def complete_clips(data: Path, names: Sequence[str] = ()) -> list[Clip]:
    """Those named, or all in which every moving object is labelled.

    Raises: SourceError as ``read_clips``, or where there is none.
    """
    clips = [clip for clip in read_clips(data, names) if clip.complete or names]
    if not clips:
        raise SourceError(f'{data}: expected clips with complete_gt, found none')
    return clips


def results(job: Job) -> Iterator[tuple[int, Result]]:
    """Number of every frame of a clip, and what a fresh pipeline makes of it."""
    source = job.clip.source()
    pipeline = MotionPipeline(with_settings(load_preset(job.clip.preset), job.changes), source.camera)
    for frame in islice(source, job.clip.limit):
        yield frame.index, pipeline.process(frame.image, frame.stamp_ns)


def run_clip(job: Job) -> ClipRun:
    """Every frame of a clip through a fresh pipeline."""
    detections, times = dict[int, RecordArray](), []
    for index, result in results(job):
        detections[index] = result.detections
        times.append(result.times_ms.total)
    return ClipRun(job.clip, detections, float(np.median(times)))


def run_jobs(jobs: Sequence[Job], processes: int) -> Iterator[ClipRun]:
    """The runs in the order of the jobs: see ``in_processes``."""
    yield from in_processes(run_clip, jobs, processes)


def in_processes(run: Callable[[Task], Outcome], tasks: Sequence[Task], processes: int) -> Iterator[Outcome]:
    """``run`` of every task, in their order, in ``processes`` processes of one OpenCV thread each."""
    if processes <= 1:
        yield from track(map(run, tasks), len(tasks), 'runs')
        return
    context = multiprocessing.get_context('spawn')
    with ProcessPoolExecutor(processes, context, cv2.setNumThreads, (1,)) as pool:
        yield from track(pool.map(run, tasks), len(tasks), 'runs')
