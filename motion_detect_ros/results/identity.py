"""Identity over time: HOTA, IDF1 and id switches, by the package TrackEval.

    pip install --no-deps trackeval    # its dependencies would replace OpenCV; what is used here needs numpy and scipy

HOTA (Luiten et al., IJCV 2021) is the mean over IoU 0.05 to 0.95; IDF1 (Ristani et al., ECCV 2016) and id switches
(Bernardin and Stiefelhagen, 2008) are at one IoU each.
"""

from __future__ import annotations

import contextlib
import dataclasses
import importlib
import io
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from motion_detect_ros.core.errors import BackendError, SourceError
from motion_detect_ros.core.types import RecordArray, empty_detections
from motion_detect_ros.results.metrics import boxes_of, boxes_of_truth, by_frame, judge_frame, overlaps

LOOSE_IOU = 0.3
IOUS = (LOOSE_IOU, 0.5)


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


def sequence(
    truth: RecordArray, detections: Mapping[int, RecordArray], frames: Sequence[int], wanted: Sequence[int],
) -> dict[str, Any]:
    """Truth and detections as TrackEval's metrics want them: ids from 0 without gaps, a similarity matrix a frame.

    truth: ``TRUTH_DTYPE``; detections: ``DETECTION_DTYPE`` by frame; frames: those counted, in order; wanted: values of
    ``moving`` to be found, as in ``results.metrics``. Raises: SourceError where an id is twice in a frame, or below 0.
    """
    goals, found, labelled = [], [], by_frame(truth)
    for frame in frames:
        records = detections.get(frame, empty_detections())
        verdict = judge_frame(labelled.get(frame, truth[:0]), boxes_of(records), LOOSE_IOU, wanted)
        goals.append(_identified(verdict.wanted, 'truth', frame))
        found.append(_identified(records[~verdict.ignored], 'detections', frame))
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
    metrics = load_trackeval()
    hota = metrics.HOTA().eval_sequence(data)
    clear = metrics.CLEAR({'THRESHOLD': LOOSE_IOU, 'PRINT_CONFIG': False}).eval_sequence(data)
    idf1 = [metrics.Identity({'THRESHOLD': iou, 'PRINT_CONFIG': False}).eval_sequence(data)['IDF1'] for iou in IOUS]
    means = {name: float(np.mean(hota[name])) for name in ('HOTA', 'DetA', 'AssA')}
    return TrackScore(means['HOTA'], means['DetA'], means['AssA'], float(idf1[0]), float(idf1[1]),
                      int(clear['IDSW']), int(clear['MT']), data['num_gt_ids'])


def table(scores: Mapping[str, TrackScore]) -> list[str]:
    """Markdown, a row a clip and the mean."""
    lines = ['| clip | HOTA | DetA | AssA | IDF1 at 0.3 | IDF1 at 0.5 | id switches | tracks found in 80 % of frames |',
             '|---|---|---|---|---|---|---|---|']
    rows = {f'`{name}`': dataclasses.astuple(score) for name, score in scores.items()}
    for name, row in {**rows, f'mean of {len(rows)}': tuple(np.mean(list(rows.values()), axis=0))}.items():
        lines.append(f'| {name} | ' + ' | '.join(f'{value:.2f}' for value in row[:5])
                     + f' | {row[5]:.4g} | {row[6]:.4g} of {row[7]:.4g} |')
    return lines


def load_trackeval() -> Any:
    """Its metrics. Importing prints which of its data sets lack a package; none of them is used."""
    try:
        with contextlib.redirect_stdout(io.StringIO()):
            return importlib.import_module('trackeval.metrics')
    except ImportError as error:
        raise BackendError(
            f'identity over time needs the package trackeval ({error}): pip install --no-deps trackeval') from None


def _identified(records: RecordArray, what: str, frame: int) -> RecordArray:
    """Raises: SourceError where the ids do not tell the objects of a frame apart."""
    ids, times = np.unique(records['id'], return_counts=True)
    odd = ids[(times > 1) | (ids < 0)]
    if odd.size:
        raise SourceError(f'--identity: expected an id from 0 on for each object of the {what}, each once in a frame, '
                          f'got {int(odd[0])} {int(times[ids == odd[0]][0])} times in frame {frame}')
    return records


def _numbers(frames: Sequence[RecordArray]) -> dict[int, int]:
    """Each id, in order, to its place."""
    ids = sorted({int(ident) for records in frames for ident in records['id'].tolist()})
    return {ident: number for number, ident in enumerate(ids)}


def _numbered(records: RecordArray, numbers: Mapping[int, int]) -> np.ndarray:
    return np.array([numbers[int(ident)] for ident in records['id'].tolist()], int)
