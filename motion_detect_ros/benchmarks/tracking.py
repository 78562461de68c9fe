"""Identity over time on the completely labelled clips: HOTA, IDF1 and id switches, by the package TrackEval.

    pip install --no-deps trackeval    # its dependencies would replace OpenCV; what is used here needs numpy and scipy
    python -m motion_detect_ros.benchmarks.tracking [CLIP ...] [--data DIR] [--jobs N] [--all-objects]
        [--set NAME=VALUE ...] [--write docs/accuracy.md]

Warm-up frames and detections on ignored boxes count as in the accuracy table; see ``results.identity``.
"""

from __future__ import annotations

import argparse
import sys
from collections.abc import Sequence
from pathlib import Path

from motion_detect_ros.benchmarks.accuracy import add_run_arguments, add_settings, read_changes
from motion_detect_ros.benchmarks.accuracy_clips import ClipRun, Job, complete_clips, run_jobs
from motion_detect_ros.benchmarks.command import reports_errors
from motion_detect_ros.benchmarks.generated import show
from motion_detect_ros.results.identity import TrackScore, load_trackeval, score_tracks, sequence, table
from motion_detect_ros.results.metrics import COUNTINGS, frame_count

SECTION = 'tracking'


def score_run(run: ClipRun, counting: str) -> TrackScore:
    """One clip; counting: a key of ``COUNTINGS``."""
    truth = run.clip.read_truth()
    frames = range(run.skip, frame_count(truth, run.detections))
    return score_tracks(sequence(truth, run.detections, frames, COUNTINGS[counting]))


@reports_errors
def main(arguments: Sequence[str] | None = None) -> int:
    """The command; exit code 2 where clips are wrong or TrackEval is missing."""
    parser = argparse.ArgumentParser(prog='tracking', description='HOTA, IDF1 and id switches on real clips.')
    parser.add_argument('clips', nargs='*', help='names of clips (default: all that are completely labelled)')
    add_run_arguments(parser)
    add_settings(parser)
    parser.add_argument('--all-objects', action='store_true', help='want every labelled object, moving or not')
    parser.add_argument('--write', type=Path, metavar='FILE', help='put the table into this document, too')
    options = parser.parse_args(arguments)
    load_trackeval()
    clips = complete_clips(options.data, options.clips)
    changes = read_changes(options.set)
    counting = 'all' if options.all_objects else 'moving'
    runs = run_jobs([Job(clip, changes) for clip in clips], options.jobs)
    lines = table({run.clip.name: score_run(run, counting) for run in runs})
    show(lines, options.write, SECTION)
    return 0


if __name__ == '__main__':
    sys.exit(main())
