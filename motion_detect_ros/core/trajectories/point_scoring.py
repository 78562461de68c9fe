"""Log odds of one cluster of points from one frame.

A logistic regression (Cox 1958) of "this cluster is a moving object" on three figures without unit. The coefficients
were fitted over those clusters of the real clips in docs/accuracy.md where flow is not certain of an object, every clip
with equal weight.
"""

from __future__ import annotations

import math

INTERCEPT = -6.4
PER_LOG_POINTS = 1.23
PER_MOVING_SHARE = 2.1
PER_LOG_SPREAD = -0.36
#: Floor of the spread, and the highest log odds of one frame.
SPREAD_FLOOR, MAX_LOG_ODDS = 0.02, 3.0


def point_log_odds(points: int, moving_share: float, spread: float) -> float:
    """Logarithm of p / (1 - p), p the probability that a cluster is a moving object.

    points: how many there are, at least 1; moving_share: of the points in its box, 0..1; spread: median deviation of
    their velocities, share of their speed.
    """
    odds = (INTERCEPT + PER_LOG_POINTS * math.log(points) + PER_MOVING_SHARE * moving_share
            + PER_LOG_SPREAD * math.log(spread + SPREAD_FLOOR))
    return min(MAX_LOG_ODDS, odds)
