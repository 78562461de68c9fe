"""Frames left out: which ones, and that velocities stay true."""

from __future__ import annotations

import numpy as np
import pytest

from motion_detect_ros.core.config import PipelineConfig
from motion_detect_ros.core.errors import ConfigError
from motion_detect_ros.core.frame_decimation import FrameDecimation
from motion_detect_ros.core.pipeline import MotionPipeline
from motion_detect_ros.core.settings import with_settings
from motion_detect_ros.sources.synthetic import FlightConfig, SyntheticFlight


@pytest.mark.parametrize(('take', 'of', 'wanted'), [
    (1, 1, [0, 1, 2, 3, 4, 5, 6, 7, 8, 9]), (1, 3, [0, 3, 6, 9]), (2, 5, [0, 1, 5, 6]), (5, 5, [*range(10)])])
def test_the_first_m_of_every_n(take, of, wanted):
    decimation = FrameDecimation(take, of)
    assert [index for index in range(10) if decimation.keep_next()] == wanted
    assert decimation.active == (take < of)
    decimation.reset()
    assert decimation.keep_next()


@pytest.mark.parametrize(('take', 'of'), [(1, 1), (1, 3), (2, 5), (5, 5), (3, 4)])
def test_so_many_of_a_run_are_kept_at_least(take, of):
    """Against every run there is: counted one by one."""
    decimation = FrameDecimation(take, of)
    kept = [decimation.keep_next() for _ in range(60)]
    for run in range(20):
        assert decimation.kept_at_least(run) == min(sum(kept[first:first + run]) for first in range(40))


def test_more_than_all_is_refused():
    with pytest.raises(ConfigError, match=r'load\.decimation_keep: expected at most load\.decimation_of \(2\), got 3'):
        with_settings(PipelineConfig(), {'load.decimation_keep': 3, 'load.decimation_of': 2})


@pytest.mark.parametrize(('take', 'of'), [(1, 1), (1, 2), (2, 3)])
def test_velocity_is_per_second_whatever_is_left_out(take, of):
    """A square that drives 4 pixels a frame at 20 Hz, over ground that the camera crosses at 3: 80 pixels a second."""
    decimation, pipeline, speeds = FrameDecimation(take, of), MotionPipeline(), []
    for frame in SyntheticFlight(FlightConfig.single(40.0, 4.0, 3.0, frames=30)):
        if decimation.keep_next():
            records = pipeline.process(frame.image, frame.stamp_ns).detections
            speeds += [float(record['vel_u']) for record in records]
    assert len(speeds) >= 5
    assert np.median(speeds) == pytest.approx(80.0, rel=0.05)
