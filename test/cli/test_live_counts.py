"""Which node left images out, from what each has answered: worked out by hand."""

from __future__ import annotations

import pytest

pytest.importorskip('rclpy', reason='ROS 2 is not installed')

from motion_detect_ros.cli.live_replay import left_out_by


@pytest.mark.parametrize(('processed', 'answered', 'left_out'), [
    ((60, 60, 60), 60, {}),
    ((36, 28, 27), 27, {'ego_motion': 24, 'optical_flow': 8, 'art2_clustering': 1}),
    ((60, 60, 60), 57, {'transport': 3}),
    ((60, 50, 50), 50, {'optical_flow': 10}),
    ((40, 30, 20), 58, {'ego_motion': 2}),  # a node's latest report is older than its answers
    ((60, 70, 60), 59, {'transport': 1}),
])
def test_left_out(processed: tuple[int, int, int], answered: int, left_out: dict[str, int]) -> None:
    stages = dict(zip(('ego_motion', 'optical_flow', 'art2_clustering'), processed, strict=True))
    found = left_out_by(stages, 60, answered)
    assert found == left_out
    assert sum(found.values()) == 60 - answered


def test_a_node_that_has_reported_nothing_is_passed_over() -> None:
    assert left_out_by({'art2_clustering': 58}, 60, 57) == {'art2_clustering': 2, 'transport': 1}
