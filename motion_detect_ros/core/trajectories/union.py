"""Candidates of dense flow and of point trajectories, without those that stand for the same object."""

from __future__ import annotations

import numpy as np

from motion_detect_ros.core.detection.candidate import Candidate
from motion_detect_ros.core.types import BoolArray, DoubleArray

#: Candidates of flow with lower log odds give way to those of the points.
CERTAIN_LOG_ODDS = -1.0
#: The same object: intersection over union, or over the smaller box's area, from these on.
SAME_IOU, SAME_CONTAINED = 0.2, 0.4
#: A part of a larger object: it is so many times smaller, beside it with this margin, share of the own size, and
#: differs in velocity by less than this share of its own.
LARGER, BESIDE_SHARE, ALIKE_SHARE = 1.5, 0.25, 0.3


def united(from_flow: list[Candidate], from_points: list[Candidate]) -> list[Candidate]:
    """One candidate for each object: flow's where flow is certain, else that of the points, else flow's."""
    certain = [one for one in from_flow if one.log_odds >= CERTAIN_LOG_ODDS]
    doubtful = [one for one in from_flow if one.log_odds < CERTAIN_LOG_ODDS]
    added = _without_known(from_points, certain)
    return [*certain, *added, *_without_known(doubtful, added)]


def _without_known(ones: list[Candidate], others: list[Candidate]) -> list[Candidate]:
    """Those that stand for none of the others."""
    if not ones or not others:
        return ones
    known = _same(ones, others) | _fragment(ones, others)
    return [one for one, row in zip(ones, known, strict=True) if not row.any()]


def _edges(candidates: list[Candidate], margin_share: float = 0.0) -> tuple[DoubleArray, DoubleArray]:
    centre = np.array([one.centre for one in candidates])
    half = np.array([one.size for one in candidates]) * (0.5 + margin_share)
    return centre - half, centre + half


def _intersection(one: tuple[DoubleArray, DoubleArray], other: tuple[DoubleArray, DoubleArray]) -> DoubleArray:
    """(n, m) area."""
    low, high = np.maximum(one[0][:, None], other[0]), np.minimum(one[1][:, None], other[1])
    area: DoubleArray = np.clip(high - low, 0.0, None).prod(axis=2)
    return area


def _areas(candidates: list[Candidate]) -> DoubleArray:
    area: DoubleArray = np.array([one.size for one in candidates]).prod(axis=1)
    return area


def _same(ones: list[Candidate], others: list[Candidate]) -> BoolArray:
    """(n, m) whether the boxes overlap by so much that they show one object."""
    shared = _intersection(_edges(ones), _edges(others))
    area, other_area = _areas(ones)[:, None], _areas(others)
    same: BoolArray = ((shared >= SAME_IOU * (area + other_area - shared))
                       | (shared >= SAME_CONTAINED * np.minimum(area, other_area)))
    return same


def _fragment(ones: list[Candidate], others: list[Candidate]) -> BoolArray:
    """(n, m) whether the first is beside a larger other that moves the same way."""
    beside = _intersection(_edges(ones, BESIDE_SHARE), _edges(others)) > 0.0
    velocity, other_velocity = (np.array([one.velocity_px_s for one in each]) for each in (ones, others))
    difference = velocity[:, None] - other_velocity
    alike = (np.hypot(difference[..., 0], difference[..., 1])
             < ALIKE_SHARE * np.hypot(velocity[:, 0], velocity[:, 1])[:, None])
    fragment: BoolArray = beside & alike & (_areas(others) > LARGER * _areas(ones)[:, None])
    return fragment
