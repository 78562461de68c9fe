"""Log odds of one cluster of points from one frame.

A logistic regression (Cox 1958) of "this cluster is a moving object" on three figures without unit. The coefficients
were fitted over the clusters of the real clips in docs/accuracy.md (``benchmarks.point_score_fit``), every clip with
equal weight, the intercept then lowered by 1 so that false boxes are rare.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import NamedTuple

#: The highest log odds of one frame.
MAX_LOG_ODDS = 3.0


class ClusterFigures(NamedTuple):
    """``points``: how many a cluster has, at least 1; ``moving_share``: of the points in its box, 0..1;
    ``moving_around``: of those around its box, 0..1.
    """

    points: int
    moving_share: float
    moving_around: float

    @property
    def regressors(self) -> tuple[float, float, float]:
        """What the coefficients of a ``PointScore`` after the intercept belong to."""
        return math.log(self.points), self.moving_share, self.moving_around


@dataclass(frozen=True)
class PointScore:
    """Coefficients; objects of less than ``least`` log odds are dropped."""

    intercept: float = -11.3
    per_log_points: float = 1.5
    per_moving_share: float = 6.9
    per_moving_around: float = -0.8
    least: float = -2.0

    def log_odds(self, figures: ClusterFigures) -> float:
        """Logarithm of p / (1 - p), p the probability that a cluster with these figures is a moving object."""
        coefficients = self.per_log_points, self.per_moving_share, self.per_moving_around
        odds = sum((c * x for c, x in zip(coefficients, figures.regressors, strict=True)), self.intercept)
        return min(MAX_LOG_ODDS, odds)


POINT_SCORE = PointScore()
