"""Tracks of exact motions under an exact camera motion."""

from __future__ import annotations

import numpy as np
import pytest

from motion_detect_ros.core.config import TracksConfig
from motion_detect_ros.core.scoring import log_odds, probability
from motion_detect_ros.core.tracks import Candidate, Tracker

DT_S = 0.05
CONFIG = TracksConfig(confirm_hits=3, confirm_frames=5, coast_frames=2)


def candidate(u: float, v: float, velocity=(0.0, 0.0), size=(30.0, 20.0), log_odds=2.0) -> Candidate:
    return Candidate(np.array([u, v]), np.array(size), np.array(velocity, float), 300.0, log_odds, 1)


def test_confirmed_after_enough_hits_and_never_by_flicker():
    tracker = Tracker(CONFIG)
    counts = [len(tracker.step([candidate(100, 100)], np.eye(3), DT_S, 640, 480)) for _ in range(4)]
    assert counts == [0, 0, 1, 1]
    tracker = Tracker(CONFIG)
    for index in range(20):  # seen every third frame: two hits in five
        seen = [candidate(100, 100)] if index % 3 == 0 else []
        assert len(tracker.step(seen, np.eye(3), DT_S, 640, 480)) == 0


def test_velocity_is_that_over_ground_however_the_camera_zooms_and_pans():
    zoom = np.array([[1.01, 0, -4.0], [0, 1.01, 2.0], [0, 0, 1]])
    tracker, position, velocity = Tracker(CONFIG), np.array([200.0, 150.0]), np.array([80.0, -40.0])
    for _ in range(40):
        velocity = velocity * 1.01
        position = (zoom @ [*position, 1.0])[:2] + velocity * DT_S
        records = tracker.step([candidate(*position, velocity)], zoom, DT_S, 640, 480)
    assert records['vel_u'][0] == pytest.approx(velocity[0], rel=0.02)
    assert records['vel_v'][0] == pytest.approx(velocity[1], rel=0.02)
    assert records['u'][0] == pytest.approx(position[0], abs=0.5)
    assert records['age'][0] == 40


def test_crossing_objects_keep_their_ids():
    tracker = Tracker(CONFIG)
    for index in range(30):
        a, b = candidate(100 + 6 * index, 100, (120, 0)), candidate(280 - 6 * index, 130, (-120, 0))
        records = tracker.step([a, b] if index % 2 else [b, a], np.eye(3), DT_S, 640, 480)
        by_id = {int(r['id']): r for r in records}
        if index == 5:
            right = next(number for number, r in by_id.items() if r['vel_u'] > 0)
    assert by_id[right]['vel_u'] > 100 and len(by_id) == 2


def test_coasts_along_its_prediction_and_then_ends():
    tracker = Tracker(CONFIG)
    for index in range(10):
        seen = tracker.step([candidate(100 + 5 * index, 100, (100, 0))], np.eye(3), DT_S, 640, 480)
    first = tracker.step([], np.eye(3), DT_S, 640, 480)
    assert first['u'][0] == pytest.approx(150, abs=1.0)
    assert 0.0 < first['score'][0] < seen['score'][0] <= 1.0
    assert [len(tracker.step([], np.eye(3), DT_S, 640, 480)) for _ in range(3)] == [1, 0, 0]


def test_ids_are_never_used_twice():
    tracker, seen = Tracker(CONFIG), set()
    for _ in range(3):
        for _ in range(4):
            records = tracker.step([candidate(50, 50)], np.eye(3), DT_S, 640, 480)
        assert int(records['id'][0]) not in seen
        seen.add(int(records['id'][0]))
        tracker.reset()


def test_frames_without_ego_motion_count_as_misses():
    tracker = Tracker(CONFIG)
    for _ in range(4):
        tracker.step([candidate(50, 50)], np.eye(3), DT_S, 640, 480)
    tracker.skip()
    assert len(tracker.step([candidate(50, 50)], np.eye(3), DT_S, 640, 480)) == 1
    for _ in range(CONFIG.coast_frames + 1):
        tracker.skip()
    assert len(tracker.step([candidate(50, 50)], np.eye(3), DT_S, 640, 480)) == 0


def test_boxes_are_cut_at_the_border_and_end_outside():
    tracker = Tracker(CONFIG)
    for index in range(12):
        records = tracker.step([candidate(570 + 5 * index, 100, (100, 0))], np.eye(3), DT_S, 640, 480)
    # centre at 625, 30 px wide: 610 .. 640
    assert records['u'][0] + records['width'][0] / 2 == pytest.approx(640.0, abs=1e-3)
    assert records['u'][0] - records['width'][0] / 2 == pytest.approx(610.0, abs=2.0)
    counts = [len(tracker.step([], np.array([[1, 0, 10.0], [0, 1, 0], [0, 0, 1]]), DT_S, 640, 480)) for _ in range(2)]
    assert counts == [0, 0]


def test_weak_candidates_need_more_of_them_and_doubtful_ones_are_never_reported():
    def first_report(log_odds: float) -> int | None:
        tracker = Tracker(TracksConfig(confirm_hits=3, confirm_frames=5, confirm_log_odds=1.0))
        for index in range(30):
            if len(tracker.step([candidate(100, 100, log_odds=log_odds)], np.eye(3), DT_S, 640, 480)):
                return index
        return None
    # evidence is summed with a memory of 0.8: 0.3, 0.54, 0.732, 0.886, 1.008
    assert (first_report(2.0), first_report(0.3), first_report(-0.5)) == (2, 4, None)


def test_score_is_the_probability_of_the_summed_evidence():
    assert probability(0.0) == 0.5
    assert probability(np.log(3.0)) == pytest.approx(0.75)
    # -14.1 + 0.75 ln 1000 + 1.75 ln 20 + 7.5 * 0.8 = -14.1 + 5.1808 + 5.2425 + 6
    assert log_odds(1000, 20.0, 0.8) == pytest.approx(2.3233, abs=1e-3)
    tracker = Tracker(CONFIG)
    for _ in range(3):
        records = tracker.step([candidate(50, 50, log_odds=1.0)], np.eye(3), DT_S, 640, 480)
    # 1, 1.8, 2.44
    assert records['score'][0] == pytest.approx(1.0 / (1.0 + np.exp(-2.44)), abs=1e-6)
