"""Without truth: what the detector finds in a flight, and finds again in the same flight backwards.

What really moves is there in both directions, in one piece and with one identity; much of what is noise is not. Tracks
of both runs are matched one to one, by the number of frames in which their boxes overlap; a box counts as agreed where
it overlaps that of the track matched with its own. A track that breaks, or changes its object, loses the frames of all
pieces but one, so that stability counts too. Errors that repeat themselves in both directions count as right: parallax
that is taken for motion, for instance.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from scipy.optimize import linear_sum_assignment

from motion_detect_ros.results.found import Found
from motion_detect_ros.results.metrics import NO_BOXES, CountArray, match_pairs


def agreement(forward: Found, backward: Found, frames: Sequence[int], iou: float) -> CountArray:
    """(F, 2) of each of ``frames``: boxes of the forward run that agree, boxes of either run that do not."""
    pairs = [match_pairs(forward.boxes.get(frame, NO_BOXES), backward.boxes.get(frame, NO_BOXES), iou)
             for frame in frames]
    partners = [[(forward.ids[frame][one], backward.ids[frame][other]) for one, other in of_frame]
                for frame, of_frame in zip(frames, pairs, strict=True)]
    same = _matched_tracks([pair for of_frame in partners for pair in of_frame])
    counts = np.zeros((len(frames), 2), np.int64)
    for row, frame, of_frame in zip(counts, frames, partners, strict=True):
        agreed = sum(pair in same for pair in of_frame)
        boxes = len(forward.boxes.get(frame, NO_BOXES)) + len(backward.boxes.get(frame, NO_BOXES))
        row[:] = agreed, boxes - 2 * agreed
    return counts


def against_each_other(start: CountArray, candidate: CountArray) -> CountArray:
    """(2, F, 3) hits, false and wanted, as ``frame_counts`` has them, of two runs with (F, 2) of ``agreement``.

    Wanted is, in every frame, what the better of the two agrees on: a run that agrees on few boxes only has misses.
    """
    best = np.maximum(start[:, 0], candidate[:, 0])
    return np.stack([np.stack([2 * run[:, 0], run[:, 1], 2 * best], axis=-1) for run in (start, candidate)])


def _matched_tracks(partners: Sequence[tuple[int, int]]) -> set[tuple[int, int]]:
    """The pairs of ids, one to one, that overlap in most frames together."""
    if not partners:
        return set()
    ids, times = np.unique(np.array(partners, np.int64), axis=0, return_counts=True)
    ones, rows = np.unique(ids[:, 0], return_inverse=True)
    others, columns = np.unique(ids[:, 1], return_inverse=True)
    together = np.zeros((len(ones), len(others)), np.int64)
    together[rows, columns] = times
    return {(int(ones[row]), int(others[column]))
            for row, column in zip(*linear_sum_assignment(together, maximize=True), strict=True)}
