"""Objects of the last flow between two flows."""

from __future__ import annotations

import numpy as np
import pytest

from motion_detect_ros.core.detection.candidate import Candidate, Growth
from motion_detect_ros.core.detection.last_flow import LastFlow
from motion_detect_ros.core.types import EgoMotion, EgoStatus

PERIOD_NS = 40_000_000


def ego(matrix: object = None, status: EgoStatus = EgoStatus.OK) -> EgoMotion:
    return EgoMotion(np.eye(3) if matrix is None else np.asarray(matrix, float), np.eye(6), status, PERIOD_NS, 0)


def candidate(x: float, y: float, speed: tuple[float, float] = (0.0, 0.0)) -> Candidate:
    return Candidate(np.array([x, y]), np.array([20.0, 10.0]), np.array(speed), 150.0, 2.0, 3, Growth(0.1, 1, 0.04, 5))


def test_own_velocity_and_camera_carry_an_object() -> None:
    last = LastFlow(0.12)
    assert last.replaced([candidate(100.0, 50.0, (50.0, -25.0))])[0].centre.tolist() == [100.0, 50.0]
    (moved,) = last.carried(ego([[1, 0, 7], [0, 1, -3], [0, 0, 1]]))
    assert moved.centre == pytest.approx([100 + 7 + 2, 50 - 3 - 1])
    assert moved.size.tolist() == [20.0, 10.0] and moved.velocity_px_s.tolist() == [50.0, -25.0]
    assert (moved.log_odds, moved.cluster, moved.growth) == (2.0, 3, None)
    (again,) = last.carried(ego())
    assert again.centre == pytest.approx([107 + 2 + 2, 47 - 1 - 1])


def test_a_quarter_turn_and_zoom_turn_the_velocity_and_grow_the_box() -> None:
    last = LastFlow(0.12)
    last.replaced([candidate(10.5, 20.5, (100.0, 0.0))])  # the centre of pixel (10, 20)
    (moved,) = last.carried(ego([[0, -2, 0], [2, 0, 0], [0, 0, 1]]))
    assert moved.velocity_px_s == pytest.approx([0.0, 200.0])
    assert moved.centre == pytest.approx([-40 + 0.5, 20 + 0.5 + 8])
    assert moved.size == pytest.approx([40.0, 20.0])


def test_they_end_after_two_intervals_and_where_the_camera_motion_is_unknown() -> None:
    last = LastFlow(0.08)
    last.replaced([candidate(100.0, 50.0)])
    assert [len(last.carried(ego())) for _ in range(6)] == [1, 1, 1, 1, 0, 0]
    assert last.age_s == pytest.approx(0.24)
    last.replaced([candidate(100.0, 50.0)])
    assert last.age_s == 0.0 and len(last.carried(ego())) == 1
    assert last.carried(ego(status=EgoStatus.DEGENERATE)) == [] == last.carried(ego())


def test_with_flow_in_every_frame_nothing_is_carried_and_reset_clears() -> None:
    last = LastFlow(0.0)
    last.replaced([candidate(100.0, 50.0)])
    assert last.carried(ego()) == []
    last = LastFlow(1.0)
    last.replaced([candidate(100.0, 50.0)])
    last.reset()
    assert last.carried(ego()) == [] and last.age_s == pytest.approx(0.04)


def test_what_comes_a_frame_late_is_carried_to_it_and_counts_as_measured_once() -> None:
    last = LastFlow(0.12)
    last.replaced_late([candidate(100.0, 50.0, (50.0, 0.0))])
    (first,) = last.carried(ego([[1, 0, 7], [0, 1, -3], [0, 0, 1]]))
    assert first.centre == pytest.approx([109, 47])
    assert first.measured and first.growth == Growth(0.1, 1, 0.04, 5)
    (second,) = last.carried(ego())
    assert second.centre == pytest.approx([111, 47])
    assert not second.measured and second.growth is None
