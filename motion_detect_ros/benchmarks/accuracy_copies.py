"""How much of a difference in accuracy is luck: every clip in eight copies that a detector should find equally hard.

    python -m motion_detect_ros.benchmarks.accuracy_copies [CLIP ...] [--data DIR] [--set NAME=VALUE ...] [--write FILE]

As it is and mirrored, whole and without a few columns, forwards and backwards. Which pixels a picture consists of
decides about objects at the edge of being found, and settings that were chosen on these very pixels have got used to
them: the copies tell that from what is better. Prints mean and deviation of F1 over them.
"""

from __future__ import annotations

import argparse
import itertools
import math
import sys
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from motion_detect_ros.benchmarks.accuracy import add_run_arguments, add_settings, read_changes
from motion_detect_ros.benchmarks.accuracy_clips import IOUS, ClipRun, Job, in_processes, read_clips
from motion_detect_ros.benchmarks.command import reports_errors
from motion_detect_ros.benchmarks.generated import show
from motion_detect_ros.core.pipeline import MotionPipeline
from motion_detect_ros.core.settings import with_settings
from motion_detect_ros.core.types import ByteArray, DoubleArray, RecordArray
from motion_detect_ros.presets import load_preset
from motion_detect_ros.results.metrics import COUNTINGS, Score, score_boxes

#: Place in a document.
SECTION = 'copies'
#: Columns that the cropped copies lack on the left, pixels.
CROPPED_PX = 12


@dataclass(frozen=True)
class Copy:
    """What is done to the pictures of a clip."""

    mirrored: bool
    cropped_px: int
    backwards: bool

    def picture(self, image: ByteArray) -> ByteArray:
        """image: (H, W) or (H, W, 3)."""
        kept = image[:, self.cropped_px:]
        return np.ascontiguousarray(kept[:, ::-1] if self.mirrored else kept)

    def undone(self, records: RecordArray, width: int) -> RecordArray:
        """Detections in a copied picture, where they are in the original one of ``width`` pixels."""
        there = records.copy()
        there['u'] = width - records['u'] if self.mirrored else records['u'] + self.cropped_px
        return there


#: The original comes first.
COPIES = tuple(Copy(*each) for each in itertools.product((False, True), (0, CROPPED_PX), (False, True)))


@dataclass(frozen=True)
class CopyJob(Job):
    """The same for a copy of the clip."""

    copy: Copy


@reports_errors
def main(arguments: Sequence[str] | None = None) -> int:
    """The command; exit code 2 where clips or settings are wrong."""
    parser = argparse.ArgumentParser(prog='accuracy_copies', description='Mean and deviation of F1 over like copies.')
    parser.add_argument('clips', nargs='*', help='names of clips (default: all)')
    add_run_arguments(parser)
    add_settings(parser)
    parser.add_argument('--write', type=Path, metavar='FILE', help='put the table into this document, too')
    options = parser.parse_args(arguments)
    changes, clips = read_changes(options.set), read_clips(options.data, options.clips)
    jobs = [CopyJob(clip, changes, copy) for clip in clips for copy in COPIES]
    found = figures(list(in_processes(run_copy, jobs, options.jobs)))
    show(table([clip.name for clip in clips], found), options.write, SECTION)
    return 0


def run_copy(job: CopyJob) -> tuple[Score, ...]:
    """Every frame of a copy through a fresh pipeline, scored at each of ``IOUS``.

    Without calibration, which would be another one.
    """
    pipeline = MotionPipeline(with_settings(load_preset(job.clip.preset), job.changes))
    truth, detections = job.clip.read_truth(), dict[int, RecordArray]()
    frames = [(frame.image, frame.stamp_ns) for frame in itertools.islice(job.clip.source(), job.clip.limit)]
    if job.copy.backwards:
        both_ends = frames[0][1] + frames[-1][1]
        frames = [(image, both_ends - stamp_ns) for image, stamp_ns in reversed(frames)]
        truth['frame'] = len(frames) - 1 - truth['frame']
    for index, (image, stamp_ns) in enumerate(frames):
        found = pipeline.process(job.copy.picture(image), stamp_ns).detections
        detections[index] = job.copy.undone(found, image.shape[1])
    run = ClipRun(job.clip, detections, math.nan)
    return tuple(score_boxes(truth, run.boxes(), iou, COUNTINGS['moving'], run.skip, run.frames) for iou in IOUS)


def figures(runs: Sequence[tuple[Score, ...]]) -> DoubleArray:
    """(clips, copies, 3) F1 at each of ``IOUS`` and false boxes a frame. runs: clip by clip."""
    each = [[*(score.f1 for score in scores), scores[0].false_per_frame] for scores in runs]
    return np.array(each).reshape(-1, len(COPIES), len(IOUS) + 1)


def table(names: Sequence[str], found: DoubleArray) -> list[str]:
    """Markdown: a row a clip, and the mean of all with the deviation of that mean from copy to copy."""
    rows = [(f'`{name}`', one) for name, one in zip(names, found, strict=True)]
    rows.append((f'mean of {len(names)}', found.mean(axis=0)))
    head = [f'F1 at {iou:g}' for iou in IOUS] + ['false boxes a frame']
    return [f'| mean (deviation) of {len(COPIES)} copies | {" | ".join(head)} |', '|---' * (len(head) + 1) + '|',
            *(f'| {name} | ' + ' | '.join(f'{mean:.3f} ({deviation:.3f})' for mean, deviation in zip(
                one.mean(axis=0).tolist(), one.std(axis=0, ddof=1).tolist(), strict=True)) + ' |'
              for name, one in rows)]


if __name__ == '__main__':
    sys.exit(main())
