"""Answers depend on the pictures alone: not on OpenCV's random numbers, which every thread has its own of."""

from __future__ import annotations

import threading

import cv2
import numpy as np
import pytest

from motion_detect_ros.core.config import PipelineConfig
from motion_detect_ros.core.pipeline import MotionPipeline
from motion_detect_ros.core.settings import with_settings

PERIOD_NS = 40_000_000
FRAMES = 10


def scene(index: int) -> np.ndarray:
    """Noisy ground that drifts by 3 px a frame with a square that goes the other way: RANSAC has outliers to refuse."""
    ground = cv2.GaussianBlur(np.random.default_rng(1).normal(size=(240, 400)), (0, 0), 1.5)
    picture = cv2.normalize(ground, None, 20, 235, cv2.NORM_MINMAX)[:, 3 * index:3 * index + 320]
    picture[60:120, 60 + 5 * index:120 + 5 * index] = 255 - picture[120:180, 100:160]
    picture += np.random.default_rng(100 + index).normal(scale=4.0, size=picture.shape)
    return picture.clip(0, 255).astype(np.uint8)


def answers(pipeline: MotionPipeline) -> bytes:
    results = [pipeline.process(scene(index), (index + 1) * PERIOD_NS) for index in range(FRAMES)]
    return b''.join(result.detections.tobytes() + result.ego.matrix.tobytes() for result in results)


def in_thread(pipeline: MotionPipeline, seed: int) -> bytes:
    """The answers in a thread of its own, whose OpenCV is in the state that ``seed`` gives."""
    found: list[bytes] = []

    def work() -> None:
        cv2.setRNGSeed(seed)
        found.append(answers(pipeline))

    thread = threading.Thread(target=work)
    thread.start()
    thread.join()
    return found[0]


CONFIGS: dict[str, dict[str, str | bool]] = {
    'default': {}, 'homography': {'ego_motion.model': 'homography'},
    'similarity in space': {'ego_motion.model': 'similarity', 'ego_motion.relative_pose': True},
    'epipolar': {'background.model': 'epipolar'},
}


@pytest.mark.parametrize('values', CONFIGS.values(), ids=CONFIGS)
def test_every_thread_gives_the_same_bytes(values: dict[str, str | bool]):
    config = with_settings(PipelineConfig(), values)
    here = MotionPipeline(config)
    assert len({answers(here), *(in_thread(MotionPipeline(config), seed) for seed in (1, 2, 3))}) == 1


def test_the_random_numbers_of_the_caller_go_on():
    cv2.setRNGSeed(7)
    expected = [cv2.randu(np.zeros((1, 4)), 0.0, 1.0).tolist() for _ in range(2)]
    cv2.setRNGSeed(7)
    first = cv2.randu(np.zeros((1, 4)), 0.0, 1.0).tolist()
    answers(MotionPipeline(with_settings(PipelineConfig(), {'ego_motion.relative_pose': True})))
    assert [first, cv2.randu(np.zeros((1, 4)), 0.0, 1.0).tolist()] == expected
