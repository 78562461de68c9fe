"""Ids that grow over restarts, within what the fields of the messages hold."""

from __future__ import annotations

from datetime import UTC, datetime

import numpy as np

from motion_detect_ros.bridge.track_ids import first_id
from motion_detect_ros.core.config import TracksConfig
from motion_detect_ros.core.detection.candidate import Candidate
from motion_detect_ros.core.tracking.tracker import Tracker
from motion_detect_ros.core.types import DETECTION_DTYPE, MAX_ID


def seconds(*date: int) -> float:
    return datetime(*date, tzinfo=UTC).timestamp()


def test_ids_fit_the_field_of_the_message():
    assert np.iinfo(DETECTION_DTYPE['id']).max == MAX_ID
    assert all(1 <= first_id(seconds(year, 1, 1)) <= MAX_ID for year in range(1970, 2100))


def test_first_ids_grow_with_time_for_years():
    starts = [first_id(seconds(year, month, 1)) for year in range(2026, 2039) for month in range(1, 13)]
    assert starts == sorted(set(starts))
    assert first_id(seconds(2026, 6, 1) + 60) - first_id(seconds(2026, 6, 1)) == 600


def test_a_clock_that_is_not_set_gives_1():
    assert first_id(0.0) == first_id(seconds(2020, 1, 1)) == 1


def test_after_the_largest_id_comes_1():
    tracker = Tracker(TracksConfig(), MAX_ID)
    seen = [Candidate(np.array([u, 100.0]), np.array([30.0, 20.0]), np.zeros(2), 300.0, 2.0, 1) for u in (100.0, 400.0)]
    for _ in range(6):
        records = tracker.step(seen, np.eye(3), 0.05, 640, 480)
    assert sorted(records['id'].tolist()) == [1, MAX_ID]
