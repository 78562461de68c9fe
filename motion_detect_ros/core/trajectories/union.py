"""One candidate for each object, from those of dense flow and those of point trajectories."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from motion_detect_ros.core.detection.candidate import Candidate
from motion_detect_ros.core.geometry.boxes import Edges, shared_areas
from motion_detect_ros.core.geometry.vectors import magnitude
from motion_detect_ros.core.types import BoolArray, DoubleArray

#: Two boxes show the same place: intersection over union, share of the points' box inside, share of flow's box inside.
SAME_IOU, POINTS_INSIDE, FLOW_INSIDE = 0.2, 0.5, 0.4
#: Intersection over union of two views of one object, and the weight of the points' view of its box.
ONE_OBJECT_IOU, POINTS_WEIGHT = 0.3, 0.7
#: A large candidate of flow with so high log odds stays where those of the points cover less than this share of it.
CERTAIN_LOG_ODDS, COVERED_SHARE = 0.0, 0.5
#: A part of a larger object: it is so many times smaller, beside it with this margin, share of the own size, and
#: differs in velocity by less than this share of its own.
LARGER, BESIDE_SHARE, ALIKE_SHARE = 1.5, 0.25, 0.3


def united(from_flow: list[Candidate], from_points: list[Candidate], largest_px: float) -> list[Candidate]:
    """One candidate for each object.

    Where one of each source shows an object, their boxes are averaged. Elsewhere a candidate of flow gives way to those
    of the points that are there: neighbours that flow cannot tell apart, or an object that it saw a part of. Of what is
    larger than ``largest_px``, the longest side that points show unless they are dense, they may see parts only.
    """
    if not from_points or not from_flow:
        return from_flow + from_points
    area, other_area = _areas(from_flow)[:, None], _areas(from_points)
    shared = shared_areas(_edges(from_flow), _edges(from_points))
    iou = shared / (area + other_area - shared)
    same = (iou >= SAME_IOU) | (shared >= POINTS_INSIDE * other_area) | (shared >= FLOW_INSIDE * area)
    bare = np.where(same, shared, 0.0).sum(axis=1) < COVERED_SHARE * area[:, 0]
    alone: list[Candidate] = []
    points, parts = list(from_points), set[int]()
    for index, (candidate, row, is_bare) in enumerate(zip(from_flow, same.tolist(), bare.tolist(), strict=True)):
        there = [place for place, is_there in enumerate(row) if is_there]
        if is_bare and candidate.log_odds >= CERTAIN_LOG_ODDS and candidate.size.max() > largest_px:
            alone.append(candidate)
            parts.update(there)
        elif len(there) == 1 and iou[index, there[0]] >= ONE_OBJECT_IOU:
            points[there[0]] = _averaged(candidate, from_points[there[0]])
        elif not there:
            alone.append(candidate)
    points = [one for place, one in enumerate(points) if place not in parts]
    alone = _without_fragments(alone, points)
    return alone + _without_fragments(points, alone)


def _averaged(from_flow: Candidate, from_points: Candidate) -> Candidate:
    centre, size = (POINTS_WEIGHT * one + (1.0 - POINTS_WEIGHT) * other for one, other in (
        (from_points.centre, from_flow.centre), (from_points.size, from_flow.size)))
    return replace(from_flow, centre=centre, size=size, velocity_px_s=from_points.velocity_px_s,
                   log_odds=max(from_flow.log_odds, from_points.log_odds), measured=True)


def _without_fragments(ones: list[Candidate], others: list[Candidate]) -> list[Candidate]:
    """Those that are not beside a larger one of the others that moves the same way."""
    if not ones or not others:
        return ones
    beside = shared_areas(_edges(ones, BESIDE_SHARE), _edges(others)) > 0.0
    velocity, other_velocity = (np.array([one.velocity_px_s for one in each]) for each in (ones, others))
    difference = velocity[:, None] - other_velocity
    alike = magnitude(difference) < ALIKE_SHARE * magnitude(velocity)[:, None]
    fragment: BoolArray = np.any(beside & alike & (_areas(others) > LARGER * _areas(ones)[:, None]), axis=1)
    return [one for one, is_one in zip(ones, fragment.tolist(), strict=True) if not is_one]


def _edges(candidates: list[Candidate], margin_share: float = 0.0) -> Edges:
    centre = np.array([one.centre for one in candidates])
    half = np.array([one.size for one in candidates]) * (0.5 + margin_share)
    return centre - half, centre + half


def _areas(candidates: list[Candidate]) -> DoubleArray:
    area: DoubleArray = np.array([one.size for one in candidates]).prod(axis=1)
    return area
