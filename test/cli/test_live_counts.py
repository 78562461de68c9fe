"""Which node left images out, from what each has answered: worked out by hand."""

from __future__ import annotations

from pathlib import Path

import pytest

pytest.importorskip('rclpy', reason='ROS 2 is not installed')

from motion_detect_ros.cli.batch.jobs import Job
from motion_detect_ros.cli.live import Playback
from motion_detect_ros.cli.live_replay import Recorded, left_out_by, live_summary
from motion_detect_ros.cli.planner import Received
from motion_detect_ros.core.config import PipelineConfig
from motion_detect_ros.core.settings import with_settings
from motion_detect_ros.core.types import empty_detections


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


@pytest.mark.parametrize(('keep_of', 'skipped', 'processed', 'answers', 'left_out', 'complete'), [
    (1, 20, 40, 40, {'load.adapt': 20}, True),
    (1, 20, 39, 38, {'load.adapt': 20, 'ego_motion': 1, 'transport': 1}, False),
    (3, 40, 20, 20, {}, True),                   # 1 of 3 by the settings is not asked for
    (3, 50, 10, 10, {'load.adapt': 10}, True),   # 1 of 6
])
def test_what_the_load_leaves_out_makes_nothing_partial(
    keep_of: int, skipped: int, processed: int, answers: int, left_out: dict[str, int], complete: bool,
) -> None:
    """Of 60 images, by what the first stage says it left out on purpose."""
    job = Job('a.mcap', Path('out'), with_settings(PipelineConfig(), {'load.decimation_of': keep_of}))
    heard = tuple(Received(number, empty_detections(), 20.0) for number in range(answers))
    playback = Playback(heard, 60, 1.0, 0.0, {'ego_motion': processed}, skipped)
    summary = live_summary(job, None, Recorded(60, tuple(range(60)), {}), heard, playback)
    assert (summary.left_out, summary.complete) == (left_out, complete)
