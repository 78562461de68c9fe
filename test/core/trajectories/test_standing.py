"""Boxes of flow over points of which it is known whether they move."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from still_camera import frames_of

from motion_detect_ros.core.detection.candidate import Candidate
from motion_detect_ros.core.trajectories.object_motion import PointMotion
from motion_detect_ros.core.trajectories.point_evidence import PointEvidence
from motion_detect_ros.core.trajectories.points import Points
from motion_detect_ros.core.trajectories.recent_frames import MAX_FRAMES
from motion_detect_ros.core.trajectories.soft_shadows import SoftShadows
from motion_detect_ros.core.trajectories.standing import StandingPoints

#: A lattice of points every 10 pixels, from 5 to 195; any of them would have told 40 pixels/s.
LATTICE = np.stack(np.meshgrid(np.arange(5.0, 200.0, 10.0), np.arange(5.0, 200.0, 10.0)), axis=-1).reshape(-1, 2)
TELLING_PX_S = 40.0


def points_at(places: np.ndarray, first: int = 0) -> Points:
    path = np.full((len(places), MAX_FRAMES, 2), np.nan, np.float32)
    path[:, 0] = places
    return Points(path, np.full(len(places), 20, np.int32), np.zeros((len(places), 2), np.float32),
                  first + np.arange(len(places), dtype=np.int64))


def box(left: float, top: float, right: float, bottom: float, speed: float = 60.0) -> Candidate:
    low, high = np.array([left, top]), np.array([right, bottom])
    return Candidate((low + high) / 2.0, high - low, np.array([0.6, -0.8]) * speed, 100.0, 2.0, 1)


def standing_on(points: Points, sigmas: np.ndarray | float = 0.0, evidence: np.ndarray | float = 0.0,
                chosen: np.ndarray | None = None) -> StandingPoints:
    count = len(points)
    motion = replace(PointMotion.at_rest(count), sigmas=np.broadcast_to(sigmas, count),
                     evidence=np.broadcast_to(evidence, count), least_speed=np.full(count, TELLING_PX_S))
    standing = StandingPoints()
    standing.measured(points, motion, np.arange(count) if chosen is None else np.flatnonzero(chosen))
    return standing


def denied(candidate: Candidate, sigmas: np.ndarray | float = 0.0, evidence: np.ndarray | float = 0.0,
           chosen: np.ndarray | None = None, now: Points | None = None, scale: float = 1.0) -> bool:
    points = points_at(LATTICE)
    return standing_on(points, sigmas, evidence, chosen).denied([candidate], now or points, scale)[0]


def test_a_box_full_of_standing_points_is_no_object():
    assert denied(box(20, 20, 80, 80))


def test_what_points_do_not_deny_is_more_certain():
    """292 of 604 false candidates are not denied, and all right ones: ln(604 / 292) = 0.727."""
    points, beside, gray = points_at(LATTICE), box(300, 300, 360, 360), np.zeros((400, 400), np.uint8)
    evidence = PointEvidence(points, standing_on(points), SoftShadows(frames_of([gray], 1)), gray.shape, 1.0)
    found = evidence.without_standing([box(20, 20, 80, 80), beside])
    assert [each.centre.tolist() for each in found] == [beside.centre.tolist()]
    assert found[0].log_odds == pytest.approx(beside.log_odds + 0.727, abs=0.03)
    assert beside.log_odds == 2.0


def test_points_of_which_a_tenth_moves_deny_nothing():
    """36 points in the box, four of them move."""
    inside = ((LATTICE > 20) & (LATTICE < 80)).all(axis=1)
    sigmas = np.zeros(len(LATTICE))
    sigmas[np.flatnonzero(inside)[:3]] = 9.0
    assert denied(box(20, 20, 80, 80), sigmas)
    sigmas[np.flatnonzero(inside)[:4]] = 9.0
    assert not denied(box(20, 20, 80, 80), sigmas)


@pytest.mark.parametrize(('evidence', 'is_denied'), [(1.4, True), (1.6, False)])
def test_a_way_over_the_noise_that_was_not_steady_denies_nothing(evidence: float, is_denied: bool):
    assert denied(box(20, 20, 80, 80), evidence=evidence) is is_denied


@pytest.mark.parametrize(('speed', 'is_denied'), [(41.0, True), (39.0, False)])
def test_points_deny_only_a_motion_that_they_would_have_told(speed: float, is_denied: bool):
    assert denied(box(20, 20, 80, 80, speed)) is is_denied


def test_the_speed_counts_in_pixels_of_the_working_resolution():
    """The same box in an image of twice the size: 60 pixels/s there are 30 here, 100 are 50."""
    assert not denied(box(40, 40, 160, 160, 60.0), scale=0.5)
    assert denied(box(40, 40, 160, 160, 100.0), scale=0.5)


@pytest.mark.parametrize(('right', 'is_denied'), [(40, False), (60, True)])
def test_points_must_lie_in_two_thirds_of_the_box(right: int, is_denied: bool):
    """Points left of 40 fill one column of three, left of 60 two."""
    assert denied(box(20, 20, 80, 80), chosen=LATTICE[:, 0] < right) is is_denied


def test_many_boxes_against_the_definition():
    """Points at random, of which some are slow to tell, some move and some are doubtful."""
    random = np.random.default_rng(0)
    points = points_at(random.uniform(0, 200, (900, 2)).astype(np.float32))
    sigmas, evidence = np.where(random.random(900) < 0.09, 9.0, 0.0), random.exponential(2.0, 900)
    least = random.uniform(20.0, 70.0, 900)
    standing = StandingPoints()
    standing.measured(points, replace(PointMotion.at_rest(900), sigmas=sigmas, evidence=evidence, least_speed=least),
                      np.flatnonzero(random.random(900) < 0.9))
    old = standing._old
    boxes = [box(left, top, left + width, top + height, speed) for left, top, width, height, speed
             in random.uniform([0, 0, 8, 8, 30], [150, 150, 50, 50, 90], (200, 5))]

    def stands(each: Candidate) -> bool:
        share = (points.now[old] - each.centre) / each.size + 0.5
        telling = ((share >= 0.0) & (share < 1.0)).all(axis=1) & (least[old] < np.hypot(*each.velocity_px_s))
        parts = {(int(3 * x), int(3 * y)) for x, y in share[telling]}
        chosen = old[telling]
        return bool(len(parts) >= 6 and (sigmas[chosen] > 0.0).mean() < 0.1 and np.median(evidence[chosen]) < 1.5)

    expected = [stands(each) for each in boxes]
    assert 20 < sum(expected) < 180
    assert standing.denied(boxes, points, 1.0) == expected


def test_where_no_motion_was_measured_nothing_is_denied():
    assert StandingPoints().denied([box(20, 20, 80, 80)], points_at(LATTICE), 1.0) == [False]


def test_points_are_asked_where_they_are_now():
    """They have gone 100 pixels to the right since; others have come."""
    gone = points_at(LATTICE + np.array([100.0, 0.0]))
    assert denied(box(120, 20, 180, 80), now=gone)
    assert not denied(box(20, 20, 80, 80), now=gone)
    assert not denied(box(20, 20, 80, 80), now=points_at(LATTICE, first=1000))
