"""Log odds of one cluster of points from one frame.

A logistic regression (Cox 1958) of "this cluster is a moving object" on three figures without unit. The coefficients
were fitted over the clusters of the real clips in docs/accuracy.md, every clip with equal weight, the intercept then
lowered by 1 so that false boxes are rare.
"""

from __future__ import annotations

import math

INTERCEPT = -6.6
PER_LOG_POINTS = 1.6
PER_MOVING_SHARE = 2.2
PER_MOVING_AROUND = -1.3
#: The highest log odds of one frame.
MAX_LOG_ODDS = 3.0


def point_log_odds(points: int, moving_share: float, moving_around: float) -> float:
    """Logarithm of p / (1 - p), p the probability that a cluster is a moving object.

    points: how many there are, at least 1; moving_share: of the points in its box, 0..1; moving_around: of those
    around its box, 0..1.
    """
    odds = (INTERCEPT + PER_LOG_POINTS * math.log(points) + PER_MOVING_SHARE * moving_share
            + PER_MOVING_AROUND * moving_around)
    return min(MAX_LOG_ODDS, odds)
