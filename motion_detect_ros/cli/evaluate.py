"""``evaluate``: precision, recall and F1 of a detections.csv against ground truth.

All frames count: those of the replay where its summary.json lies beside detections.csv, at least those up to the last
one with truth or detections. Where nothing is labelled, every box is false. ``--last-frame`` is for truth that ends
before the pictures do.
"""

from __future__ import annotations

import argparse
import csv
import json
import operator
from collections import defaultdict
from pathlib import Path

import numpy as np

from motion_detect_ros.cli.metrics import MOVING_AND_STANDING, MOVING_ONLY, Score, frame_count, score_boxes
from motion_detect_ros.cli.outputs import CSV_NAME, SUMMARY_NAME
from motion_detect_ros.core.errors import SourceError
from motion_detect_ros.core.types import DoubleArray
from motion_detect_ros.sources.truth import Truth, load_truth

#: Frames at the start that are not counted: a detector that confirms over frames reports nothing there yet.
WARM_UP_FRAMES = 10
DEFAULT_IOUS = (0.3, 0.5)

_BOX_COLUMNS = ('frame', 'x', 'y', 'w', 'h')


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the command line."""
    parser.add_argument('detections', type=Path, help='CSV with at least frame,x,y,w,h; frames from 0')
    parser.add_argument('--truth', type=Path, required=True, help='VisDrone annotation, KITTI labels or CSV')
    parser.add_argument('--iou', type=float, nargs='+', default=list(DEFAULT_IOUS), help='overlaps that count as hit')
    parser.add_argument('--skip', type=int, default=WARM_UP_FRAMES, help='frames at the start not counted')
    parser.add_argument('--last-frame', type=int, metavar='N', help='last frame counted (default: the last of all)')
    parser.add_argument('--json', action='store_true', help='print one JSON object')


def run(arguments: argparse.Namespace) -> int:
    """Print the table, return the exit code. Raises: SourceError for an unreadable file or an IoU outside 0..1."""
    if not all(0 < iou <= 1 for iou in arguments.iou):
        raise SourceError(f'--iou: expected numbers over 0 up to 1, got {" ".join(map(str, arguments.iou))}')
    if arguments.skip < 0:
        raise SourceError(f'--skip: expected 0 or more frames, got {arguments.skip}')
    if arguments.last_frame is not None and arguments.last_frame < arguments.skip:
        raise SourceError(f'--last-frame: expected {arguments.skip} (--skip) or later, got {arguments.last_frame}')
    truth, found = load_truth(arguments.truth), read_boxes(arguments.detections)
    frames = max(frame_count(truth.boxes, found), replayed_frames(arguments.detections))
    if arguments.last_frame is not None:
        frames = arguments.last_frame + 1
    scores = evaluate(found, truth, arguments.iou, arguments.skip, frames)
    counted = max(0, frames - arguments.skip)
    print(_as_json(scores, truth, counted) if arguments.json else _as_table(scores, truth, counted))
    return 0


def read_boxes(path: Path) -> dict[int, DoubleArray]:
    """Boxes (N, 4) as x, y, w, h by frame, from a CSV with a header. Raises: SourceError."""
    rows: defaultdict[int, list[list[float]]] = defaultdict(list)
    try:
        with path.open(newline='', encoding='utf-8') as stream:
            reader = csv.DictReader(stream)
            missing = [name for name in _BOX_COLUMNS if name not in (reader.fieldnames or [])]
            if missing:
                raise SourceError(f'{path}: column {", ".join(missing)} is missing; expected frame,x,y,w,h')
            for cells in reader:
                rows[int(float(cells['frame']))].append([float(cells[name]) for name in _BOX_COLUMNS[1:]])
    except OSError as error:
        raise SourceError(f'{path}: detections cannot be read: {error.strerror}') from None
    except (ValueError, TypeError) as error:
        raise SourceError(f'{path}, line {reader.line_num}: {error}') from None
    return {frame: np.array(boxes, np.float64) for frame, boxes in rows.items()}


def replayed_frames(detections: Path) -> int:
    """Frames of the source that ``detections`` are of, unreadable and left-out ones included; 0 without a summary.

    Raises: SourceError where the summary has no count.
    """
    path = detections.with_name(SUMMARY_NAME)
    if detections.name != CSV_NAME or not path.is_file():
        return 0
    try:
        summary = json.loads(path.read_text(encoding='utf-8'))
        return operator.index(summary['source_frames'])
    except (OSError, ValueError, KeyError, TypeError) as error:
        found = f'{type(error).__name__} {error}'
        raise SourceError(f'{path}: expected the count source_frames, got {found}') from None


def evaluate(
    predictions: dict[int, DoubleArray], truth: Truth, ious: list[float], skip: int, frames: int | None = None,
) -> dict[str, Score]:
    """Scores by name: ``moving@0.3`` wants what moves, ``all@0.3`` standing objects too; frames as ``score_boxes``.

    Where truth does not say what moves, every object counts as moving and both are the same.
    """
    countings = {'moving': MOVING_ONLY, 'all': MOVING_AND_STANDING}
    return {f'{name}@{iou:g}': score_boxes(truth.boxes, predictions, iou, wanted, skip, frames)
            for name, wanted in countings.items() for iou in ious}


def _counting(truth: Truth) -> str:
    if truth.says_what_moves:
        return 'moving: only objects labelled as moving are wanted; all: standing ones too'
    return f'the {truth.form} does not say what moves: every labelled object is wanted, in both countings'


def _as_json(scores: dict[str, Score], truth: Truth, frames: int) -> str:
    content: dict[str, object] = {'frames': frames, 'truth': truth.form, 'counting': _counting(truth)}
    for name, score in scores.items():
        content[name] = {
            'precision': score.precision, 'recall': score.recall, 'f1': score.f1, 'gt': score.wanted,
            'true_positives': score.true_positives, 'false_positives': score.false_positives,
            'false_negatives': score.wanted - score.true_positives, 'false_per_frame': score.false_per_frame}
    return json.dumps(content)


def _as_table(scores: dict[str, Score], truth: Truth, frames: int) -> str:
    lines = [f'{frames} frames; {_counting(truth)}',
             f'{"counting@IoU":12s} precision  recall     F1   hits  false missed false/frame']
    lines += [f'{name:12s} {s.precision:9.3f} {s.recall:7.3f} {s.f1:6.3f} {s.true_positives:6d} '
              f'{s.false_positives:6d} {s.wanted - s.true_positives:6d} {s.false_per_frame:11.2f}'
              for name, s in scores.items()]
    return '\n'.join(lines)
