"""Frames left out: which ones, and that velocities stay true."""

from __future__ import annotations

import cv2
import numpy as np
import pytest

from motion_detect_ros.core.config import LoadConfig, PipelineConfig
from motion_detect_ros.core.errors import ConfigError
from motion_detect_ros.core.load import FrameSelection, use_threads
from motion_detect_ros.core.pipeline import MotionPipeline
from motion_detect_ros.core.settings import with_settings
from motion_detect_ros.sources.synthetic import FlightConfig, SyntheticFlight


@pytest.mark.parametrize(('take', 'of', 'wanted'), [
    (1, 1, [0, 1, 2, 3, 4, 5, 6, 7, 8, 9]), (1, 3, [0, 3, 6, 9]), (2, 5, [0, 1, 5, 6]), (5, 5, [*range(10)])])
def test_the_first_m_of_every_n(take, of, wanted):
    selection = FrameSelection(LoadConfig(take=take, of=of))
    assert [index for index in range(10) if selection.wants()] == wanted
    assert selection.leaves_out == (take < of)
    selection.reset()
    assert selection.wants()


def test_more_than_all_is_refused():
    with pytest.raises(ConfigError, match=r'load\.take: expected at most load\.of \(2\), got 3'):
        with_settings(PipelineConfig(), {'load.take': 3, 'load.of': 2})


@pytest.mark.parametrize(('take', 'of'), [(1, 1), (1, 2), (2, 3)])
def test_velocity_is_per_second_whatever_is_left_out(take, of):
    """A square that drives 4 pixels a frame at 20 Hz, over ground that the camera crosses at 3: 80 pixels a second."""
    selection, pipeline, speeds = FrameSelection(LoadConfig(take=take, of=of)), MotionPipeline(), []
    for frame in SyntheticFlight(FlightConfig.single(40.0, 4.0, 3.0, frames=30)):
        if selection.wants():
            records = pipeline.process(frame.image, frame.stamp_ns).detections
            speeds += [float(record['vel_u']) for record in records]
    assert len(speeds) >= 5
    assert np.median(speeds) == pytest.approx(80.0, rel=0.05)


def test_threads_are_those_asked_for():
    before = cv2.getNumThreads()
    try:
        use_threads(LoadConfig(threads=1))
        assert cv2.getNumThreads() == 1
        use_threads(LoadConfig(threads=0))
        assert cv2.getNumThreads() == 1
    finally:
        cv2.setNumThreads(before)
