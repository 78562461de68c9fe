"""The fit of the score of small objects."""

from __future__ import annotations

import math

import numpy as np
import pytest

from motion_detect_ros.benchmarks import point_score_fit
from motion_detect_ros.benchmarks.accuracy_table import f1_table
from motion_detect_ros.benchmarks.point_score_fit import (
    LOWERED,
    Judged,
    coefficient_table,
    collect_flight,
    fit,
)
from motion_detect_ros.core.errors import SourceError
from motion_detect_ros.core.trajectories.point_scoring import MAX_LOG_ODDS, ClusterFigures, PointScore

#: Intercept, then one for each regressor.
TRUE = np.array([-3.0, 1.2, 2.5, -1.5])


def drawn(count: int, seed: int, coefficients: np.ndarray = TRUE) -> Judged:
    """Clusters whose truth is drawn with the probability that the coefficients give."""
    random = np.random.default_rng(seed)
    x = np.column_stack([np.log(random.integers(5, 60, count)), random.uniform(size=count), random.uniform(size=count)])
    odds = coefficients[0] + x @ coefficients[1:]
    return Judged(x, random.uniform(size=count) < 1.0 / (1.0 + np.exp(-odds)))


def fitted(*clips: Judged) -> list[float]:
    score = fit(clips)
    return [score.intercept + LOWERED, score.per_log_points, score.per_moving_share, score.per_moving_around]


def test_recovers_the_coefficients_that_the_truth_was_drawn_with() -> None:
    assert fitted(drawn(20000, 1), drawn(20000, 2)) == pytest.approx(TRUE, abs=0.15)


def test_every_clip_counts_alike() -> None:
    """A clip of ten times as many clusters and another law would else decide alone."""
    small, large = drawn(4000, 1), drawn(40000, 2, TRUE * [1.0, 1.0, -1.0, 1.0])
    again = Judged(np.tile(small.regressors, (10, 1)), np.tile(small.right, 10))
    assert fitted(small, large) == pytest.approx(fitted(again, large), abs=0.01)
    assert abs(fitted(small, large)[2]) < 1.5, 'between 2.5 and -2.5'


def test_clusters_that_a_line_separates_have_a_finite_score() -> None:
    x = np.zeros((20, 3))
    x[:, 1] = np.linspace(0.0, 1.0, 20)
    score = fit([Judged(x, x[:, 1] > 0.5)])
    assert 5.0 < score.per_moving_share < 1000.0


@pytest.mark.parametrize('right', [[], [True, True], [False]])
def test_nothing_to_tell_apart_is_said(right: list[bool]) -> None:
    with pytest.raises(SourceError, match='expected right and wrong clusters, got'):
        fit([Judged(np.zeros((len(right), 3)), np.array(right, bool))])


def test_log_odds_by_hand() -> None:
    score = PointScore(-1.0, 2.0, 3.0, -4.0)
    assert score.log_odds(ClusterFigures(1, 0.5, 0.25)) == pytest.approx(-1.0 + 0.0 + 1.5 - 1.0)
    assert score.log_odds(ClusterFigures(7, 0.0, 0.0)) == pytest.approx(-1.0 + 2.0 * math.log(7))
    assert score.log_odds(ClusterFigures(1000, 1.0, 0.0)) == MAX_LOG_ODDS


def test_tables_of_known_runs() -> None:
    class Run:
        def __init__(self, *f1: float) -> None:
            self._f1 = f1

        def scores(self) -> list[Run]:
            return [Score(f1) for f1 in self._f1]

    class Score:
        def __init__(self, f1: float) -> None:
            self.f1 = f1

    class Named:
        def __init__(self, name: str) -> None:
            self.name = name

    lines = f1_table([Named('a'), Named('b')], {  # type: ignore[list-item]
        'one': [Run(0.5, 0.25), Run(0.7, 0.35)], 'other': [Run(1.0, 0.0), Run(0.0, 1.0)]})  # type: ignore[list-item]
    assert lines[0] == '| F1 at 0.3 / 0.5 | one | other |'
    assert lines[2] == '| `a` | 0.500 / 0.250 | 1.000 / 0.000 |'
    assert lines[4] == '| mean of 2 | 0.600 / 0.300 | 0.500 / 0.500 |'
    assert coefficient_table({'x': PointScore(1.0, 2.0, 3.0, 4.0)})[2] == '| x | 1.00 | 2.00 | 3.00 | 4.00 |'


def test_clusters_of_a_flight_are_judged_against_its_truth() -> None:
    judged = collect_flight(seed=1, frames=25)
    assert len(judged.right) > 10
    assert judged.right.any()
    assert (judged.regressors[:, 0] >= math.log(5)).all(), 'a cluster has five points'
    assert ((judged.regressors[:, 1:] >= 0.0) & (judged.regressors[:, 1:] <= 1.0)).all()


def test_wrong_folder_ends_with_a_line(capsys: pytest.CaptureFixture[str], tmp_path) -> None:
    assert point_score_fit.main(['--data', str(tmp_path)]) == 2
    assert 'expected a folder with clips.json' in capsys.readouterr().err
