"""Identity over time on the completely labelled clips: HOTA, IDF1 and id switches, by the package TrackEval.

    pip install --no-deps trackeval    # its dependencies would replace OpenCV; what is used here needs numpy and scipy
    python -m motion_detect_ros.benchmarks.tracking [CLIP ...] [--data DIR] [--jobs N] [--all-objects]
        [--set NAME=VALUE ...] [--write docs/accuracy.md]

HOTA (Luiten et al., IJCV 2021) is the mean over IoU 0.05 to 0.95; IDF1 (Ristani et al., ECCV 2016) and id switches
(Bernardin and Stiefelhagen, 2008) are at one IoU each. Warm-up frames and detections on ignored boxes count as in the
accuracy table.
"""

from __future__ import annotations

import argparse
import contextlib
import dataclasses
import importlib
import io
import sys
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from motion_detect_ros.benchmarks.accuracy import add_run_arguments, read_changes
from motion_detect_ros.benchmarks.accuracy_clips import COUNTINGS, IOUS, ClipRun, Job, complete_clips, run_jobs
from motion_detect_ros.benchmarks.generated import show
from motion_detect_ros.cli.demo_table import boxes_of
from motion_detect_ros.cli.metrics import boxes_of_truth, frame_count, judge_frame, overlaps
from motion_detect_ros.core.errors import BackendError, MotionDetectError
from motion_detect_ros.core.types import RecordArray, empty_detections

SECTION = 'tracking'
LOOSE_IOU, STRICT_IOU = IOUS


@dataclass(frozen=True)
class TrackScore:
    """Means over HOTA's thresholds: ``hota``, ``detection`` (DetA), ``association`` (AssA); at IoU 0.3 and 0.5: IDF1;
    at 0.3: identity switches and how many true tracks are found in 80 % of their frames. ``tracks``: true ones.
    """

    hota: float
    detection: float
    association: float
    idf1_30: float
    idf1_50: float
    switches: int
    mostly: int
    tracks: int


def sequence(truth: RecordArray, detections: Mapping[int, RecordArray], skip: int, wanted: Sequence[int]
             ) -> dict[str, Any]:
    """Truth and detections as TrackEval's metrics want them: ids from 0 without gaps, a similarity matrix a frame.

    truth: ``TRUTH_DTYPE``; detections: ``DETECTION_DTYPE`` by frame; skip: frames at the start not counted; the last
    is the last of either.
    """
    frames = range(skip, frame_count(truth, detections))
    goals, found = [], []
    for frame in frames:
        records = detections.get(frame, empty_detections())
        verdict = judge_frame(truth[truth['frame'] == frame], boxes_of(records), LOOSE_IOU, wanted)
        goals.append(verdict.wanted)
        found.append(records[~verdict.ignored])
    true_ids, own_ids = _numbers(goals), _numbers(found)
    return {
        'num_timesteps': len(frames),
        'gt_ids': [_numbered(one, true_ids) for one in goals], 'num_gt_ids': len(true_ids),
        'tracker_ids': [_numbered(one, own_ids) for one in found], 'num_tracker_ids': len(own_ids),
        'num_gt_dets': sum(map(len, goals)), 'num_tracker_dets': sum(map(len, found)),
        'similarity_scores': [overlaps(boxes_of_truth(goal), boxes_of(one))[0]
                              for goal, one in zip(goals, found, strict=True)]}


def score_tracks(data: dict[str, Any]) -> TrackScore:
    """TrackEval's verdict on a ``sequence``. Raises: BackendError where the package is missing."""
    metrics = _trackeval()
    hota = metrics.HOTA().eval_sequence(data)
    clear = metrics.CLEAR({'THRESHOLD': LOOSE_IOU, 'PRINT_CONFIG': False}).eval_sequence(data)
    idf1 = [metrics.Identity({'THRESHOLD': iou, 'PRINT_CONFIG': False}).eval_sequence(data)['IDF1'] for iou in IOUS]
    means = {name: float(np.mean(hota[name])) for name in ('HOTA', 'DetA', 'AssA')}
    return TrackScore(means['HOTA'], means['DetA'], means['AssA'], float(idf1[0]), float(idf1[1]),
                      int(clear['IDSW']), int(clear['MT']), data['num_gt_ids'])


def score_run(run: ClipRun, counting: str) -> TrackScore:
    """One clip; counting: a key of ``COUNTINGS``."""
    return score_tracks(sequence(run.clip.read_truth(), run.detections, run.skip, COUNTINGS[counting]))


def table(scores: Mapping[str, TrackScore]) -> list[str]:
    """Markdown, a row a clip and the mean."""
    lines = ['| clip | HOTA | DetA | AssA | IDF1 at 0.3 | IDF1 at 0.5 | id switches | tracks found in 80 % of frames |',
             '|---|---|---|---|---|---|---|---|']
    rows = {f'`{name}`': dataclasses.astuple(score) for name, score in scores.items()}
    for name, row in {**rows, f'mean of {len(rows)}': tuple(np.mean(list(rows.values()), axis=0))}.items():
        lines.append(f'| {name} | ' + ' | '.join(f'{value:.2f}' for value in row[:5])
                     + f' | {row[5]:.4g} | {row[6]:.4g} of {row[7]:.4g} |')
    return lines


def main(arguments: Sequence[str] | None = None) -> int:
    """The command; exit code 2 where clips are wrong or TrackEval is missing."""
    parser = argparse.ArgumentParser(prog='tracking', description='HOTA, IDF1 and id switches on real clips.')
    parser.add_argument('clips', nargs='*', help='names of clips (default: all that are completely labelled)')
    add_run_arguments(parser)
    parser.add_argument('--set', nargs='*', default=[], metavar='NAME=VALUE', help='settings on top of the presets')
    parser.add_argument('--all-objects', action='store_true', help='want every labelled object, moving or not')
    parser.add_argument('--write', type=Path, metavar='FILE', help='put the table into this document, too')
    options = parser.parse_args(arguments)
    try:
        _trackeval()
        clips = complete_clips(options.data, options.clips)
        changes = read_changes(options.set)
        counting = 'all' if options.all_objects else 'moving'
        runs = run_jobs([Job(clip, changes) for clip in clips], options.jobs)
        lines = table({run.clip.name: score_run(run, counting) for run in runs})
        show(lines, options.write, SECTION)
    except MotionDetectError as error:
        print(f'error: {error}', file=sys.stderr)
        return 2
    return 0


def _trackeval() -> Any:
    """Its metrics. Importing prints which of its data sets lack a package; none of them is used."""
    try:
        with contextlib.redirect_stdout(io.StringIO()):
            return importlib.import_module('trackeval.metrics')
    except ImportError as error:
        raise BackendError(f'tracking needs the package trackeval ({error}): pip install --no-deps trackeval') from None


def _numbers(frames: Sequence[RecordArray]) -> dict[int, int]:
    """Each id, in order, to its place."""
    ids = sorted({int(ident) for records in frames for ident in records['id'].tolist()})
    return {ident: number for number, ident in enumerate(ids)}


def _numbered(records: RecordArray, numbers: Mapping[int, int]) -> np.ndarray:
    return np.array([numbers[int(ident)] for ident in records['id'].tolist()], int)


if __name__ == '__main__':
    sys.exit(main())
