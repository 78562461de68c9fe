"""One candidate for each object, from those of dense flow and those of point trajectories."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from motion_detect_ros.core.detection.candidate import Candidate
from motion_detect_ros.core.geometry.boxes import Edges, shared_areas
from motion_detect_ros.core.geometry.vectors import magnitude
from motion_detect_ros.core.types import DoubleArray

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
    flow, points = _figures(from_flow), _figures(from_points)
    area, other_area = _areas(flow)[:, None], _areas(points)
    shared = shared_areas(_edges(flow), _edges(points))
    iou = shared / (area + other_area - shared)
    same = (iou >= SAME_IOU) | (shared >= POINTS_INSIDE * other_area) | (shared >= FLOW_INSIDE * area)
    bare = np.where(same, shared, 0.0).sum(axis=1) < COVERED_SHARE * area[:, 0]
    alone, parts, both = list[int](), set[int](), list(from_points)
    for index, (candidate, row, is_bare) in enumerate(zip(from_flow, same.tolist(), bare.tolist(), strict=True)):
        there = [place for place, is_there in enumerate(row) if is_there]
        if is_bare and candidate.log_odds >= CERTAIN_LOG_ODDS and candidate.size.max() > largest_px:
            alone.append(index)
            parts.update(there)
        elif len(there) == 1 and iou[index, there[0]] >= ONE_OBJECT_IOU:
            both[there[0]] = _averaged(candidate, from_points[there[0]])
            points[there[0]] = _figures([both[there[0]]])[0]
        elif not there:
            alone.append(index)
    left = [place for place in range(len(both)) if place not in parts]
    alone = _without_fragments(alone, flow, left, points)
    return [from_flow[index] for index in alone] + [
        both[place] for place in _without_fragments(left, points, alone, flow)]


def _averaged(from_flow: Candidate, from_points: Candidate) -> Candidate:
    centre, size = (POINTS_WEIGHT * one + (1.0 - POINTS_WEIGHT) * other for one, other in (
        (from_points.centre, from_flow.centre), (from_points.size, from_flow.size)))
    return replace(from_flow, centre=centre, size=size, velocity_px_s=from_points.velocity_px_s,
                   log_odds=max(from_flow.log_odds, from_points.log_odds), measured=True)


def _without_fragments(ones: list[int], figures: DoubleArray, others: list[int], of_others: DoubleArray) -> list[int]:
    """Those that are not beside a larger one of the others that moves the same way; numbers of rows of figures."""
    own, larger = figures[ones], of_others[others]
    small, large = np.nonzero(shared_areas(_edges(own, BESIDE_SHARE), _edges(larger)) > 0.0)
    if not len(small):
        return ones
    velocity = own[small, 2]
    alike = magnitude(velocity - larger[large, 2]) < ALIKE_SHARE * magnitude(velocity)
    fragments = set(small[alike & (_areas(larger)[large] > LARGER * _areas(own)[small])].tolist())
    return [one for place, one in enumerate(ones) if place not in fragments]


def _figures(candidates: list[Candidate]) -> DoubleArray:
    """(n, 3, 2) centres, sizes and velocities."""
    return np.array([(one.centre, one.size, one.velocity_px_s) for one in candidates])


def _edges(figures: DoubleArray, margin_share: float = 0.0) -> Edges:
    centre, half = figures[:, 0], figures[:, 1] * (0.5 + margin_share)
    return centre - half, centre + half


def _areas(figures: DoubleArray) -> DoubleArray:
    area: DoubleArray = figures[:, 1].prod(axis=1)
    return area
