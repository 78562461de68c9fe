"""The metric: hand-worked cases, and exact agreement with the scorer that comes with the clips."""

from __future__ import annotations

import csv
import json
import subprocess
import sys
import time
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays

from motion_detect_ros.core.types import TRUTH_DTYPE
from motion_detect_ros.results.evaluation import ClipEvaluation, Figure, evaluate_clip, figure_of
from motion_detect_ros.results.metrics import (
    COUNTINGS,
    IGNORED,
    MOVING_AND_STANDING,
    MOVING_ONLY,
    frame_counts,
    match,
    overlaps,
    score_boxes,
)
from motion_detect_ros.sources.truth import write_truth

SQUARE = np.array([[0.0, 0.0, 10.0, 10.0]])


def truth_of(*rows: tuple[float, ...]) -> np.ndarray:
    """Truth from rows (frame, x, y, w, h, moving)."""
    return np.array([(f, i, x, y, w, h, m) for i, (f, x, y, w, h, m) in enumerate(rows)], TRUTH_DTYPE)


def boxes(*rows: tuple[float, ...]) -> np.ndarray:
    return np.array(rows, np.float64)


def test_overlap_of_half_shifted_squares() -> None:
    iou, inside = overlaps(SQUARE, boxes((5, 0, 10, 10), (0, 0, 20, 20), (10, 0, 5, 5), (0, 0, 10, 10)))
    assert iou.tolist() == [[pytest.approx(1 / 3), 0.25, 0, 1]]  # 50/150, 100/400
    assert inside.tolist() == [[0.5, 1, 0, 1]]


def test_one_truth_box_is_matched_once() -> None:
    assert match(np.repeat(SQUARE, 2, axis=0), SQUARE, 0.3).tolist() == [True, False]


def test_best_overlap_goes_first() -> None:
    # The first prediction reaches both boxes, the second only the left one and better: greedy by IoU finds both.
    predicted = boxes((4, 0, 10, 10), (0, 0, 10, 10))
    wanted = boxes((0, 0, 10, 10), (8, 0, 10, 10))
    assert match(predicted, wanted, 0.3).tolist() == [True, True]


def test_labels_are_looked_through_once_not_for_every_frame() -> None:
    """200,000 labels in the first of 100,000 frames: once takes 0.2 s, for every frame 40."""
    truth = np.zeros(200_000, TRUTH_DTYPE)
    truth['moving'] = IGNORED
    begun = time.process_time()
    counts = frame_counts(truth, {99_999: SQUARE}, 0.5, MOVING_ONLY, range(100_000))
    assert time.process_time() - begun < 8.0
    assert counts.sum(axis=0).tolist() == [0, 1, 0]


def test_unsorted_labels_count_where_they_belong() -> None:
    truth = truth_of((2, 0, 0, 10, 10, 1), (0, 50, 50, 10, 10, 1), (2, 50, 50, 10, 10, 1), (0, 0, 0, 10, 10, 1))
    found = {0: boxes((50, 50, 10, 10), (0, 0, 10, 10)), 2: boxes((0, 0, 10, 10), (99, 99, 10, 10))}
    assert frame_counts(truth, found, 0.5, MOVING_ONLY, [2, 1, 0]).tolist() == [[1, 1, 2], [0, 0, 0], [2, 0, 2]]


def test_counts_by_hand() -> None:
    truth = truth_of((0, 0, 0, 10, 10, 1), (1, 0, 0, 10, 10, 1), (1, 50, 50, 10, 10, 0), (2, 0, 0, 10, 10, 1))
    found = {0: SQUARE, 1: boxes((50, 50, 10, 10)), 5: SQUARE}
    moving = score_boxes(truth, found, 0.5)
    # Hit in frame 0; the standing object of frame 1 is false; frame 2 missed; the box of frame 5 is false, as nothing
    # is labelled there.
    assert (moving.true_positives, moving.false_positives, moving.wanted, moving.frames) == (1, 2, 3, 6)
    assert (moving.precision, moving.recall) == (1 / 3, 1 / 3)
    assert moving.f1 == pytest.approx(1 / 3)
    assert moving.false_per_frame == pytest.approx(1 / 3)
    both = score_boxes(truth, found, 0.5, MOVING_AND_STANDING)
    assert (both.true_positives, both.false_positives, both.wanted) == (2, 1, 4)


def test_given_frames_are_counted_whatever_is_in_them() -> None:
    truth, found = truth_of((1, 0, 0, 10, 10, 1)), {1: SQUARE, 3: SQUARE}
    cut, whole = score_boxes(truth, found, 0.5, frames=2), score_boxes(truth, found, 0.5, frames=10)
    assert (cut.true_positives, cut.false_positives, cut.frames, cut.f1) == (1, 0, 2, 1.0)
    assert (whole.true_positives, whole.false_positives, whole.frames) == (1, 1, 10)


def test_a_clip_without_movers_is_not_perfect() -> None:
    score = score_boxes(truth_of(), {4: SQUARE, 5: np.repeat(SQUARE, 2, axis=0)}, 0.3, frames=6)
    assert (score.false_positives, score.wanted, score.frames, score.precision) == (3, 0, 6, 0.0)
    assert score.false_per_frame == 0.5


def test_skipped_frames_do_not_count() -> None:
    truth = truth_of((0, 0, 0, 10, 10, 1), (1, 0, 0, 10, 10, 1))
    score = score_boxes(truth, {0: SQUARE}, 0.5, skip=1)
    assert (score.true_positives, score.wanted, score.frames) == (0, 1, 1)


def test_ignored_boxes_swallow_what_lies_half_inside() -> None:
    truth = truth_of((0, 0, 0, 100, 100, -1))
    half, less = boxes((95, 0, 10, 10)), boxes((96, 0, 10, 10))
    assert score_boxes(truth, {0: half}, 0.3).false_positives == 0
    assert score_boxes(truth, {0: less}, 0.3).false_positives == 1


def test_nothing_anywhere() -> None:
    score = score_boxes(truth_of(), {}, 0.3)
    assert (score.precision, score.recall, score.f1, score.false_per_frame) == (0, 0, 0, 0)


@given(st.integers(0, 6).flatmap(lambda n: arrays(np.float64, (n, 4), elements=st.integers(1, 12).map(float))),
       st.integers(0, 6).flatmap(lambda n: arrays(np.float64, (n, 4), elements=st.integers(1, 12).map(float))))
def test_matching_is_one_to_one_and_maximal(predicted: np.ndarray, wanted: np.ndarray) -> None:
    matched = match(predicted, wanted, 0.3)
    assert matched.sum() <= min(len(predicted), len(wanted))
    iou, _ = overlaps(predicted, wanted)
    # A greedy matching is maximal: it leaves no prediction that reaches more boxes than there are matches.
    assert all(np.sum(iou[row] >= 0.3) <= matched.sum() for row in np.flatnonzero(~matched))


def write_random_case(folder: Path, seed: int) -> tuple[Path, Path]:
    """Crowded random truth and predictions with one decimal, many of them on or near a truth box."""
    rng = np.random.default_rng(seed)
    truth = np.zeros(200, TRUTH_DTYPE)
    truth['frame'], truth['moving'] = rng.integers(0, 20, 200), rng.choice([1, 1, 0, -1], 200)
    for name, low, high in (('x', 0, 60), ('y', 0, 40), ('w', 5, 30), ('h', 5, 30)):
        truth[name] = np.round(rng.uniform(low, high, 200), int(rng.integers(0, 2)))
    write_truth(folder / 'truth.csv', truth)
    with (folder / 'found.csv').open('w', newline='') as stream:
        writer = csv.writer(stream)
        writer.writerow(['frame', 'id', 'x', 'y', 'w', 'h', 'score'])
        for row in rng.choice(truth, 250):
            jitter = np.round(rng.choice([0, 1, 4]) * rng.normal(size=4), 1)
            x, y, w, h = (np.array([row[n] for n in ('x', 'y', 'w', 'h')]) + jitter).clip((-99, -99, 1, 1))
            writer.writerow([row['frame'], 1, f'{x:.1f}', f'{y:.1f}', f'{w:.1f}', f'{h:.1f}', 0.5])
    return folder / 'truth.csv', folder / 'found.csv'


def score_with(scorer: Path, truth: Path, found: Path, skip: int) -> dict[str, Any]:
    return json.loads(subprocess.run(
        [sys.executable, scorer, truth, found, '--json', '--skip', str(skip)],
        check=True, capture_output=True, text=True, timeout=600).stdout)


def all_figures(clips: list[ClipEvaluation]) -> list[Figure]:
    return [figure_of(clips, counting, iou) for counting in COUNTINGS for iou in (0.3, 0.5)]


@pytest.mark.parametrize('seed', range(8))
def test_agrees_with_the_clips_own_scorer(clips: Path, tmp_path: Path, seed: int) -> None:
    scorer = clips.parent / 'tools' / 'score.py'
    if not scorer.is_file():
        pytest.skip(f'no {scorer}')
    truth, found = write_random_case(tmp_path, seed)
    skip = seed % 3
    theirs = score_with(scorer, truth, found, skip)
    clip = evaluate_clip('clip', truth, {'run': found}, skip)
    ours = {figure.name: figure.scores['clip']['run'] for figure in all_figures([clip])}
    assert set(ours) == set(theirs) - {'frames'}
    for name, score in ours.items():
        assert {'precision': round(score.precision, 3), 'recall': round(score.recall, 3), 'f1': round(score.f1, 3),
                'gt': score.wanted, 'false_per_frame': round(score.false_per_frame, 2)} == theirs[name]
        assert score.frames == theirs['frames']


def test_mean_over_clips_is_that_of_the_clips_own_scorer(clips: Path, tmp_path: Path) -> None:
    scorer = clips.parent / 'tools' / 'score.py'
    if not scorer.is_file():
        pytest.skip(f'no {scorer}')
    cases, theirs = [], []
    for seed in (20, 21, 22):
        (tmp_path / str(seed)).mkdir()
        truth, found = write_random_case(tmp_path / str(seed), seed)
        cases.append(evaluate_clip(str(seed), truth, {'run': found}, skip=1))
        theirs.append(score_with(scorer, truth, found, 1))
    for figure in all_figures(cases):
        assert figure.means['run'] == pytest.approx(np.mean([one[figure.name]['f1'] for one in theirs]), abs=5e-4)
