"""Noise has no ego-motion, whatever tracks through it seem to agree on; a scene keeps its own."""

from __future__ import annotations

import cv2
import numpy as np
import pytest

from motion_detect_ros.core.config import EgoMotionConfig, PipelineConfig
from motion_detect_ros.core.ego_motion.stage import EgoMotionStage
from motion_detect_ros.core.types import EgoStatus, PreparedFrame

FRAMES = 30
SIZES = [(240, 320), (540, 960)]


def white(chance: np.random.Generator, height: int, width: int) -> np.ndarray:
    return chance.integers(0, 256, (height, width), np.uint8)


def dark_sensor(chance: np.random.Generator, height: int, width: int) -> np.ndarray:
    return np.clip(20 + 3 * chance.standard_normal((height, width)), 0, 255).astype(np.uint8)


def blurred(chance: np.random.Generator, height: int, width: int) -> np.ndarray:
    values = cv2.GaussianBlur(chance.standard_normal((height, width)), (0, 0), 2.0)
    return cv2.normalize(values, None, 0, 255, cv2.NORM_MINMAX).astype(np.uint8)


def blocks(chance: np.random.Generator, height: int, width: int) -> np.ndarray:
    return np.kron(chance.integers(0, 256, (height // 5, width // 5), np.uint8), np.ones((5, 5), np.uint8))


def statuses(images: list[np.ndarray], method: str = 'indirect') -> list[EgoStatus]:
    stage = EgoMotionStage(PipelineConfig(ego_motion=EgoMotionConfig(method=method)))
    return [stage.process(PreparedFrame(image, 1.0, image.shape[1], image.shape[0], (index + 1) * 40_000_000)).status
            for index, image in enumerate(images)]


@pytest.mark.parametrize('size', SIZES)
@pytest.mark.parametrize('noise', [white, dark_sensor, blurred, blocks])
def test_noise_is_never_an_estimate(noise, size: tuple[int, int]):
    chance = np.random.default_rng(3)
    found = statuses([noise(chance, *size) for _ in range(FRAMES)])[1:]
    assert set(found) <= {EgoStatus.DEGENERATE, EgoStatus.LOW_TEXTURE}


def test_a_scene_under_strong_noise_keeps_its_estimate():
    chance = np.random.default_rng(4)
    ground = np.kron(chance.integers(0, 256, (60, 140), np.uint8), np.ones((5, 5), np.uint8)).astype(float)
    images = [np.clip(ground[20:260, 3 * index:3 * index + 320] + 60 * chance.standard_normal((240, 320)), 0, 255)
              .astype(np.uint8) for index in range(FRAMES)]
    assert set(statuses(images)[1:]) == {EgoStatus.OK}


def test_a_scene_in_depth_that_fits_no_single_motion_keeps_its_estimate():
    """Bands at five depths that slide by 1 to 9 pixels a frame: half of each frame is pixels off any affine motion."""
    chance = np.random.default_rng(5)
    bands = [np.kron(chance.integers(0, 256, (8, 160), np.uint8), np.ones((6, 6), np.uint8)) for _ in range(5)]
    images = [np.vstack([band[:, (1 + 2 * depth) * index:(1 + 2 * depth) * index + 320]
                         for band, depth in zip(bands, (0, 3, 1, 4, 2), strict=True)]) for index in range(12)]
    found = statuses(images)[1:]
    assert found.count(EgoStatus.OK) >= 0.8 * len(found), found
