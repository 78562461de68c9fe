"""How much of a difference in accuracy is luck: every clip several times, with a few corners more or less.

    python -m motion_detect_ros.benchmarks.accuracy_spread [CLIP ...] [--data DIR] [--set NAME=VALUE ...] [--jobs N]

Which corners the ego-motion tracks decides about objects at the edge of being found. Prints mean and deviation of F1
over runs that differ in nothing else.
"""

from __future__ import annotations

import argparse
import sys
from collections.abc import Sequence

import numpy as np

from motion_detect_ros.benchmarks.accuracy import add_run_arguments, read_changes
from motion_detect_ros.benchmarks.accuracy_clips import IOUS, ClipRun, Job, read_clips, run_jobs
from motion_detect_ros.benchmarks.command import reports_errors
from motion_detect_ros.core.types import DoubleArray

#: The values of ``ego_motion.max_corners``, around the default of 700.
CORNERS = (640, 680, 720, 760)


@reports_errors
def main(arguments: Sequence[str] | None = None) -> int:
    """The command; exit code 2 where clips or settings are wrong."""
    parser = argparse.ArgumentParser(prog='accuracy_spread', description='Mean and deviation of F1 over like runs.')
    parser.add_argument('clips', nargs='*', help='names of clips (default: all)')
    add_run_arguments(parser)
    parser.add_argument('--set', nargs='*', default=[], metavar='NAME=VALUE', help='settings on top of the presets')
    options = parser.parse_args(arguments)
    changes, clips = read_changes(options.set), read_clips(options.data, options.clips)
    jobs = [Job(clip, {**changes, 'ego_motion.max_corners': count}) for clip in clips for count in CORNERS]
    found = figures(list(run_jobs(jobs, options.jobs)))
    print('\n'.join(table([clip.name for clip in clips], found)))
    return 0


def figures(runs: Sequence[ClipRun]) -> DoubleArray:
    """(clips, runs of each, 3) F1 at each of ``IOUS`` and false boxes a frame. runs: clip by clip."""
    each = [[*(score.f1 for score in run.scores()), run.scores()[0].false_per_frame] for run in runs]
    return np.array(each).reshape(-1, len(CORNERS), len(IOUS) + 1)


def table(names: Sequence[str], found: DoubleArray) -> list[str]:
    """Markdown: a row a clip, and the mean of all with the deviation of that mean."""
    rows = [(f'`{name}`', one) for name, one in zip(names, found, strict=True)]
    rows.append((f'mean of {len(names)}', found.mean(axis=0)))
    head = [f'F1 at {iou:g}' for iou in IOUS] + ['false boxes a frame']
    return [f'| mean (deviation) of {len(CORNERS)} runs | {" | ".join(head)} |', '|---' * (len(head) + 1) + '|',
            *(f'| {name} | ' + ' | '.join(f'{mean:.3f} ({deviation:.3f})' for mean, deviation in zip(
                one.mean(axis=0).tolist(), one.std(axis=0, ddof=1).tolist(), strict=True)) + ' |'
              for name, one in rows)]


if __name__ == '__main__':
    sys.exit(main())
