"""``evaluate``: precision, recall and F1 of detections against ground truth, of one clip or many, one run or several.

All frames count: those of the replay where its summary.json lies beside detections.csv, at least those up to the last
one with truth or detections. Where nothing is labelled, every box is false. ``--last-frame`` is for truth that ends
before the pictures do.
"""

from __future__ import annotations

import argparse
import sys
from pathlib import Path

from motion_detect_ros.cli.evaluate_pictures import write_worst
from motion_detect_ros.cli.evaluate_tables import as_json, as_lines
from motion_detect_ros.cli.output_folders import output_path
from motion_detect_ros.core.errors import SourceError
from motion_detect_ros.results.bootstrap import Bootstrap
from motion_detect_ros.results.clips import all_clips, clips_of, same_clips, truth_of_clips, unfinished_in
from motion_detect_ros.results.evaluation import WARM_UP_FRAMES, ClipEvaluation, evaluate_clip, figure_of
from motion_detect_ros.results.identity import TrackScore, load_trackeval, score_tracks, sequence, table
from motion_detect_ros.results.metrics import COUNTINGS

DEFAULT_IOUS = (0.3, 0.5)
#: Draws of the bootstrap, unless one clip of one run is looked at: there intervals come when asked for.
DRAWS = 1000
#: More need memory and tell nothing more: an end of an interval is sure to a hundredth of its length then.
MOST_DRAWS = 100_000
PARTIAL = 3


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the command line."""
    parser.add_argument('detections', type=Path, nargs='*', metavar='DETECTIONS',
                        help='CSV with at least frame,x,y,w,h (frames from 0), result folder, or folder of those')
    parser.add_argument('--compare', type=Path, nargs='+', default=[], metavar='RUN',
                        help='further runs over the same clips: differences to the first one')
    parser.add_argument('--truth', type=Path, nargs='+', required=True,
                        help='VisDrone, KITTI or MOT Challenge annotation or CSV, one for each clip; or a folder of '
                        'them, matched by name')
    parser.add_argument('--iou', type=float, nargs='+', default=list(DEFAULT_IOUS), help='overlaps that count as hit')
    parser.add_argument('--counting', choices=[*COUNTINGS], action='append',
                        help='moving objects only, or all labelled ones (default: both)')
    parser.add_argument('--skip', type=int, default=WARM_UP_FRAMES, help='frames at the start not counted')
    parser.add_argument('--last-frame', type=int, metavar='N', help='last frame counted (default: the last of all)')
    parser.add_argument('--bootstrap', type=int, metavar='N',
                        help=f'draws for the intervals, 0 = none (default: {DRAWS}; none for one clip of one run)')
    parser.add_argument('--block', type=int, default=Bootstrap.block_frames, metavar='N', help='frames drawn together')
    parser.add_argument('--seed', type=int, default=0, help='of the draws')
    parser.add_argument('--identity', action='store_true', help='HOTA, IDF1 and id switches too; needs trackeval')
    parser.add_argument('--worst', type=int, default=0, metavar='N', help='draw the N worst frames of each clip')
    parser.add_argument('-o', '--output', type=output_path, help='folder for those pictures')
    parser.add_argument('--json', action='store_true', help='print one JSON object')


def run(arguments: argparse.Namespace) -> int:
    """Print the tables, return the exit code: 3 where a clip has no truth.

    Raises: SourceError for an unreadable file or a wrong number; BackendError where ``--identity`` lacks its package.
    """
    _check(arguments)
    if arguments.identity:
        load_trackeval()
    runs = _runs(arguments)
    by_clip = same_clips(runs)
    truths = truth_of_clips(next(iter(runs.values())), arguments.truth)
    alone = len(by_clip) == 1 and len(runs) > 1  # the folders of one clip are named after the runs
    clips = [evaluate_clip(truths[name].stem if alone else name, truths[name], files, arguments.skip,
                           arguments.last_frame) for name, files in by_clip.items() if name in truths]
    one = len(clips) == 1 and len(runs) == 1
    draws = arguments.bootstrap if arguments.bootstrap is not None else 0 if one else DRAWS
    plan = Bootstrap(draws, arguments.block, arguments.seed) if draws else None
    countings = list(dict.fromkeys(arguments.counting or COUNTINGS))
    figures = [figure_of(clips, counting, iou, plan) for counting in countings for iou in arguments.iou]
    identity = _identity(clips, countings[0]) if arguments.identity else {}
    if arguments.json:
        print(as_json(clips, figures, plan, identity))
    else:
        print('\n'.join(as_lines(clips, figures, plan)))
        for name, scores in identity.items():
            print('\n'.join(['', f'Identity over time, {countings[0]}, {name}:', *table(scores)]))
    for path in _pictures(arguments, clips, countings[0]):
        print(path, file=sys.stderr if arguments.json else sys.stdout)
    unfinished = [name for path in (*arguments.detections, *arguments.compare) for name in unfinished_in(path)]
    left_out = {'no truth for': [name for name in by_clip if name not in truths],
                'an unfinished replay of': list(dict.fromkeys(unfinished))}
    for fault, names in left_out.items():
        if names:
            print(f'error: {fault} {", ".join(names)}: left out', file=sys.stderr)
    return PARTIAL if any(left_out.values()) else 0


def _check(arguments: argparse.Namespace) -> None:
    """Raises: SourceError for numbers outside their range and options that contradict each other."""
    if not all(0 < iou <= 1 for iou in arguments.iou):
        raise SourceError(f'--iou: expected numbers over 0 up to 1, got {" ".join(map(str, arguments.iou))}')
    for name, least in (('skip', 0), ('bootstrap', 0), ('block', 1), ('seed', 0), ('worst', 0)):
        value = getattr(arguments, name)
        if value is not None and value < least:
            raise SourceError(f'--{name}: expected {least} or more{" frames" if name == "skip" else ""}, got {value}')
    if (arguments.bootstrap or 0) > MOST_DRAWS:
        raise SourceError(f'--bootstrap: expected {MOST_DRAWS} or fewer, got {arguments.bootstrap}')
    if arguments.last_frame is not None and arguments.last_frame < arguments.skip:
        raise SourceError(f'--last-frame: expected {arguments.skip} (--skip) or later, got {arguments.last_frame}')
    if not arguments.detections and len(arguments.compare) < 2:
        raise SourceError('evaluate: expected detections, or two runs or more after --compare')
    if bool(arguments.worst) != bool(arguments.output):
        raise SourceError('--worst: expected a number of frames together with -o FOLDER')
    if arguments.worst and arguments.compare:
        raise SourceError('--worst: expected one run, got --compare as well')


def _runs(arguments: argparse.Namespace) -> dict[str, dict[str, Path]]:
    """Detections by clip, by the name of each run: what the user typed, short where that tells them apart."""
    runs = {} if not arguments.detections else {' '.join(map(str, arguments.detections)):
                                                all_clips(arguments.detections)}
    for path in arguments.compare:
        if str(path) in runs:
            raise SourceError(f'--compare: expected different runs, got {path} twice')
        runs[str(path)] = clips_of(path)
    several = ' '.join(map(str, arguments.detections)) if len(arguments.detections) > 1 else None
    short = [name if name == several else Path(name).absolute().name for name in runs]
    return dict(zip(short, runs.values(), strict=True)) if len(set(short)) == len(short) else runs


def _identity(clips: list[ClipEvaluation], counting: str) -> dict[str, dict[str, TrackScore]]:
    """The tracking figures of each clip, by run."""
    return {run: {clip.name: score_tracks(sequence(
        clip.truth.boxes, clip.found[run].records(), clip.frames, COUNTINGS[counting])) for clip in clips}
        for run in clips[0].files}


def _pictures(arguments: argparse.Namespace, clips: list[ClipEvaluation], counting: str) -> list[Path]:
    if not arguments.worst:
        return []
    return [path for clip in clips
            for path in write_worst(clip, counting, arguments.iou[0], arguments.worst, arguments.output)]
