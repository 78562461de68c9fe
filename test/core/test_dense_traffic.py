"""A road full of vehicles below a hovering camera: those of both directions are found."""

from __future__ import annotations

import numpy as np
from traffic import traffic

from motion_detect_ros.core.pipeline import MotionPipeline
from motion_detect_ros.presets import load_preset
from motion_detect_ros.results.metrics import COUNTINGS, boxes_of, score_boxes

#: Frames, and those of them that are not counted.
FRAMES, START = 30, 10


def test_vehicles_of_both_directions_are_found() -> None:
    pipeline, truth, found = MotionPipeline(load_preset('default')), [], {}
    for frame in traffic(4.0, FRAMES):
        found[frame.index] = boxes_of(pipeline.process(frame.image, frame.stamp_ns).detections)
        truth.append(frame.truth)
    score = score_boxes(np.concatenate(truth), found, 0.3, COUNTINGS['moving'], START, FRAMES)
    assert score.f1 > 0.7, score
