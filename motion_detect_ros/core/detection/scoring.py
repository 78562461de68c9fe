"""Log odds of one candidate from one frame.

A logistic regression (Cox 1958) of "this candidate is a moving object" on four figures: area of its foreground, speed
in units of the flow's noise, and share of the flow in and around its box that passed the forward-backward check. The
coefficients were fitted over the candidates of the real clips in docs/accuracy.md, every clip with equal weight, the
intercept then lowered until false boxes were rare; docs/accuracy.md says how they change when one clip is left out, and
why flow is asked for so far around a candidate.
"""

from __future__ import annotations

import math

#: Image width of the fit; areas are scaled to it.
FITTED_WIDTH_PX = 960
INTERCEPT = -25.4
PER_LOG_PIXELS = 1.9
PER_LOG_SIGMAS = 1.25
PER_KNOWN_SHARE = 5.5
PER_KNOWN_AROUND = 6.9
#: What says less for an object than this is no candidate: not having been seen says as much (``tracking.track``).
LEAST_LOG_ODDS = -2.0
#: Least motion, noise units.
MIN_SIGMAS = 0.1


def log_odds(area_share: float, sigmas: float, known_share: float, known_around: float) -> float:
    """Logarithm of p / (1 - p), p the probability that a candidate is a moving object.

    area_share: its foreground's area over the square of the image's width, so that the same object has the same at
    every resolution; sigmas: motion against the background in noise units; known_share, known_around: share of the
    cells with known flow, in its box and around it, 0..1.
    """
    pixels = area_share * FITTED_WIDTH_PX ** 2
    return (INTERCEPT + PER_LOG_PIXELS * math.log(max(1.0, pixels)) + PER_LOG_SIGMAS * math.log(max(MIN_SIGMAS, sigmas))
            + PER_KNOWN_SHARE * known_share + PER_KNOWN_AROUND * known_around)


def probability(odds: float) -> float:
    """0..1 of log odds."""
    return 1.0 / (1.0 + math.exp(-max(-50.0, min(50.0, odds))))
