"""How soon movers are found: the first frames after a start, which the accuracy tables leave out.

    python -m motion_detect_ros.benchmarks.first_frames [CLIP ...] [--set NAME=VALUE ...] [--jobs N]
        [--data DIR] [--write docs/accuracy.md]

The pipeline is started anew at every 20th frame of each clip and shown 12 frames. Prints F1 over them without the
first two, in which nothing can be known to move, and recall in single ones.
"""

from __future__ import annotations

import argparse
import sys
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from motion_detect_ros.benchmarks.accuracy import add_run_arguments, add_settings, read_changes
from motion_detect_ros.benchmarks.accuracy_clips import IOUS, SHORT_WARM_UP_FRAMES, Clip, Job, in_processes, read_clips
from motion_detect_ros.benchmarks.command import reports_errors
from motion_detect_ros.benchmarks.generated import show
from motion_detect_ros.core.pipeline import MotionPipeline
from motion_detect_ros.core.settings import with_settings
from motion_detect_ros.core.types import DoubleArray
from motion_detect_ros.presets import load_preset
from motion_detect_ros.results.bootstrap import f1_of
from motion_detect_ros.results.metrics import COUNTINGS, CountArray, boxes_of, frame_counts

SECTION = 'first frames'
#: A start at every so many frames, and frames shown.
EVERY, SHOWN = 20, 12
#: Frames after the start of which recall is told.
TOLD = (2, 3, 4, 6, 8, 11)


@dataclass(frozen=True)
class Starts:
    """``counts``: (starts, IoUs, SHOWN, 3) hits, false boxes and wanted boxes of each frame after each start."""

    clip: Clip
    counts: CountArray

    @property
    def f1(self) -> DoubleArray:
        """(IoUs,) over all starts together, 0 where nothing is wanted or found."""
        return f1_of(self.counts[:, :, SHORT_WARM_UP_FRAMES:].sum(axis=(0, 2)))

    def recall(self, frame: int) -> float:
        """At the first IoU, in one frame after the start; NaN where nothing is wanted."""
        hits, _, wanted = self.counts[:, 0, frame].sum(axis=0)
        return float(hits / wanted) if wanted else float('nan')


def starts_of(job: Job) -> Starts:
    """Starts the pipeline anew again and again over a clip."""
    source, truth = job.clip.source(), job.clip.read_truth()
    config = with_settings(load_preset(job.clip.preset), job.changes)
    counts, boxes = [], dict[int, DoubleArray]()
    for number, frame in enumerate(source):
        after = number % EVERY
        if after == 0:
            pipeline = MotionPipeline(config, source.camera)
            boxes.clear()
        if after < SHOWN:
            boxes[frame.index] = boxes_of(pipeline.process(frame.image, frame.stamp_ns).detections)
        if after == SHOWN - 1:
            counts.append([frame_counts(truth, boxes, iou, COUNTINGS['moving'], sorted(boxes)) for iou in IOUS])
    return Starts(job.clip, np.array(counts, np.int64).reshape(-1, len(IOUS), SHOWN, 3))


def table(found: Sequence[Starts]) -> list[str]:
    """Markdown."""
    head = ['clip', 'starts', *(f'F1 at {iou}' for iou in IOUS), *(f'recall in frame {frame}' for frame in TOLD)]
    f1s = np.array([each.f1 for each in found])
    recalls = np.array([[each.recall(frame) for frame in TOLD] for each in found])
    rows = [(f'`{each.clip.name}`', str(len(each.counts)), *(f'{value:.2f}' for value in (*f1, *recall)))
            for each, f1, recall in zip(found, f1s, recalls, strict=True)]
    known = [column[np.isfinite(column)] for column in recalls.T]
    mean = (f'mean of {len(found)}', str(sum(len(each.counts) for each in found)),
            *(f'{value:.3f}' for value in f1s.mean(axis=0)),
            *(f'{values.mean() if len(values) else np.nan:.2f}' for values in known))
    return [f'| {" | ".join(head)} |', '|---' * len(head) + '|', *(f'| {" | ".join(row)} |' for row in (*rows, mean))]


@reports_errors
def main(arguments: Sequence[str] | None = None) -> int:
    """The command; exit code 2 for wrong use."""
    parser = argparse.ArgumentParser(prog='first_frames', description=__doc__.partition('\n')[0])
    parser.add_argument('clips', nargs='*', metavar='CLIP', help='names (default: all)')
    add_run_arguments(parser)
    add_settings(parser)
    parser.add_argument('--write', type=Path, metavar='FILE', help='put the table into this document, too')
    options = parser.parse_args(arguments)
    changes = read_changes(options.set)
    jobs = [Job(clip, changes) for clip in read_clips(options.data, options.clips)]
    show(table(list(in_processes(starts_of, jobs, options.jobs))), options.write, SECTION)
    return 0


if __name__ == '__main__':
    sys.exit(main())
