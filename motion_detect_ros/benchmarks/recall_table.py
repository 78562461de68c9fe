"""Which moving objects are found on the completely labelled clips: recall by their size and their own speed.

    python -m motion_detect_ros.benchmarks.recall_table [CLIP ...] [--data DIR] [--jobs N] [--set NAME=VALUE ...]
        [--each] [--write docs/accuracy.md]

Recall at IoU 0.3. Size: square root of the box's area. Own speed: how far the box's centre is from where the chained
ego-motion of the detector carries its centre of up to 5 frames earlier, a frame; so it holds the errors of the
ego-motion and, seen from a camera that travels, the parallax. Boxes without an earlier one are left out; warm-up frames
count as in the accuracy table. ``--each`` adds a table for each clip.
"""

from __future__ import annotations

import argparse
import sys
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import reduce
from itertools import pairwise
from pathlib import Path

import numpy as np
import numpy.typing as npt

from motion_detect_ros.benchmarks.accuracy import add_run_arguments, add_settings, read_changes
from motion_detect_ros.benchmarks.accuracy_clips import ClipRun, Job, complete_clips, in_processes, results
from motion_detect_ros.benchmarks.accuracy_pictures import verdicts
from motion_detect_ros.benchmarks.command import reports_errors
from motion_detect_ros.benchmarks.generated import show
from motion_detect_ros.core.geometry.bearings import PIXEL_CENTRE
from motion_detect_ros.core.geometry.motion_chain import MotionChain
from motion_detect_ros.core.geometry.warp import apply
from motion_detect_ros.core.types import BoolArray, DoubleArray, FloatArray, RecordArray
from motion_detect_ros.results.metrics import boxes_of_truth

Counts = npt.NDArray[np.int64]
#: Earlier frame -> (3, 3) pixel of that frame -> pixel of this one; latest first.
Carried = Mapping[int, DoubleArray]

SECTION = 'recall'
#: Borders of the rows, pixels, and of the columns, pixels a frame; what is on a border belongs above it.
SIZES_PX = (12.0, 16.0, 24.0, 32.0, 48.0, 96.0)
SPEEDS_PX = (0.5, 1.0, 2.0, 4.0)
#: Own speed is measured over this many frames, over fewer where the object or the ego-motion does not go back so far.
MAX_FRAMES = 5
#: Cells of fewer boxes stay empty.
MIN_BOXES = 10


@dataclass(frozen=True)
class RecallCounts:
    """``hits``, ``wanted``: boxes by size (rows) and own speed (columns); ``left_out``: those of unknown speed."""

    hits: Counts
    wanted: Counts
    left_out: int

    def __add__(self, other: RecallCounts) -> RecallCounts:
        return RecallCounts(self.hits + other.hits, self.wanted + other.wanted, self.left_out + other.left_out)


def own_speeds(boxes: RecordArray, truth: RecordArray, carried: Carried) -> DoubleArray:
    """(N,) own speeds of the boxes of one frame, pixels a frame; NaN where their objects have no earlier box.

    boxes, truth: ``TRUTH_DTYPE``, of the frame and of the clip; an object has one box a frame.
    """
    speeds = np.full(len(boxes), np.nan)
    for earlier, matrix in carried.items():  # the earliest frame with the object comes last and stays
        before = truth[truth['frame'] == earlier]
        _, here, there = np.intersect1d(boxes['id'], before['id'], return_indices=True)
        moved = _centres(boxes[here]) - apply(matrix, _centres(before[there]))
        speeds[here] = np.linalg.norm(moved, axis=1) / (boxes['frame'][here] - earlier)
    return speeds


def count(boxes: RecordArray, found: BoolArray, speeds: DoubleArray) -> RecallCounts:
    """The boxes, (N,) ``TRUTH_DTYPE``, each in its cell. found: (N,); speeds: (N,) pixels a frame, NaN = unknown."""
    known = np.isfinite(speeds)
    rows = np.digitize(np.sqrt(boxes['w'] * boxes['h']), SIZES_PX)
    columns = np.digitize(speeds, SPEEDS_PX)
    hits, wanted = (np.zeros((len(SIZES_PX) + 1, len(SPEEDS_PX) + 1), np.int64) for _ in range(2))
    np.add.at(wanted, (rows[known], columns[known]), 1)
    np.add.at(hits, (rows[known & found], columns[known & found]), 1)
    return RecallCounts(hits, wanted, int((~known).sum()))


def follow_clip(job: Job) -> tuple[ClipRun, dict[int, Carried]]:
    """Every frame of a clip through a fresh pipeline, and the ego-motions into each frame.

    ``frame_ms`` of the run is unknown: NaN.
    """
    chain, frames = MotionChain(), dict[int, int]()
    detections, carried = dict[int, RecordArray](), dict[int, Carried]()
    for index, result in results(job):
        chain.append(result.ego)
        frames[result.ego.stamp_ns] = index
        detections[index] = result.detections
        carried[index] = {frames[motion.stamp_ns]: motion.matrix for motion in chain.chained()
                          if index - frames[motion.stamp_ns] <= MAX_FRAMES}
    return ClipRun(job.clip, detections, float('nan')), carried


def count_clip(job: Job) -> RecallCounts:
    """The moving objects of a clip."""
    run, carried = follow_clip(job)
    truth = run.clip.read_truth()
    return total([count(verdict.wanted, verdict.found, own_speeds(verdict.wanted, truth, carried.get(frame, {})))
                  for frame, verdict in verdicts(run, 'moving').items()])


def total(counts: Sequence[RecallCounts]) -> RecallCounts:
    """All of them together."""
    empty = np.zeros((len(SIZES_PX) + 1, len(SPEEDS_PX) + 1), np.int64)
    return reduce(RecallCounts.__add__, counts, RecallCounts(empty, empty, 0))


def table(counts: RecallCounts) -> list[str]:
    """Markdown, a row a size, a column a speed, and a sentence about all boxes."""
    lines = ['| size, px; own speed, px/frame: | ' + ' | '.join(_names(SPEEDS_PX)) + ' |',
             '|---' * (len(SPEEDS_PX) + 2) + '|']
    for name, hits, wanted in zip(_names(SIZES_PX), counts.hits.tolist(), counts.wanted.tolist(), strict=True):
        lines.append(f'| {name} | ' + ' | '.join(map(_cell, hits, wanted)) + ' |')
    hits, wanted = int(counts.hits.sum()), int(counts.wanted.sum())
    return [*lines, '', f'Together {_share(hits, wanted)} boxes; {counts.left_out} without an earlier one left out.']


@reports_errors
def main(arguments: Sequence[str] | None = None) -> int:
    """The command; exit code 2 where clips or settings are wrong."""
    parser = argparse.ArgumentParser(prog='recall_table', description='Recall on real clips by size and own speed.')
    parser.add_argument('clips', nargs='*', help='names of clips (default: all that are completely labelled)')
    add_run_arguments(parser)
    add_settings(parser)
    parser.add_argument('--each', action='store_true', help='a table for each clip, too')
    parser.add_argument('--write', type=Path, metavar='FILE', help='put the tables into this document, too')
    options = parser.parse_args(arguments)
    clips = complete_clips(options.data, options.clips)
    changes = read_changes(options.set)
    counts = list(in_processes(count_clip, [Job(clip, changes) for clip in clips], options.jobs))
    lines = table(total(counts))
    for clip, one in zip(clips, counts, strict=True) if options.each else ():
        lines += ['', f'`{clip.name}`:', '', *table(one)]
    show(lines, options.write, SECTION)
    return 0


def _centres(boxes: RecordArray) -> FloatArray:
    """(N, 2) pixels of ``TRUTH_DTYPE`` boxes; boxes are in edges of pixels, ego-motion has their centres."""
    corners = boxes_of_truth(boxes)
    return (corners[:, :2] + corners[:, 2:] / 2.0 - PIXEL_CENTRE).astype(np.float32)


def _names(borders: Sequence[float]) -> list[str]:
    between = [f'{low:g}-{high:g}' for low, high in pairwise(borders)]
    return [f'under {borders[0]:g}', *between, f'over {borders[-1]:g}']


def _cell(hits: int, wanted: int) -> str:
    return _share(hits, wanted) if wanted >= MIN_BOXES else ''


def _share(hits: int, wanted: int) -> str:
    return f'{100.0 * hits / max(wanted, 1):.0f} % of {wanted}'


if __name__ == '__main__':
    sys.exit(main())
