"""Noise has no ego-motion, whatever tracks through it seem to agree on; a scene keeps its own."""

from __future__ import annotations

import cv2
import numpy as np
import pytest

from motion_detect_ros.core.config import EgoMotionConfig, PipelineConfig
from motion_detect_ros.core.ego_motion.stage import EgoMotionStage
from motion_detect_ros.core.types import EgoMotion, EgoStatus, PreparedFrame

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


def statuses(
    images: list[np.ndarray], method: str = 'indirect', mask: np.ndarray | None = None,
) -> list[EgoStatus]:
    return [ego.status for ego in motions(images, method, mask)]


def motions(images: list[np.ndarray], method: str = 'indirect', mask: np.ndarray | None = None) -> list[EgoMotion]:
    stage = EgoMotionStage(PipelineConfig(ego_motion=EgoMotionConfig(method=method)))
    height, width = images[0].shape
    return [stage.process(PreparedFrame(image, 1.0, width, height, (index + 1) * 40_000_000, mask))
            for index, image in enumerate(images)]


def with_hull(images: list[np.ndarray], share: float) -> tuple[list[np.ndarray], np.ndarray]:
    """A hull of strong texture that stands still over so much of their lower end, and the mask that leaves it out."""
    height, width = images[0].shape
    top = round(height * (1.0 - share))
    hull = np.kron(np.random.default_rng(8).integers(0, 256, (height // 5 + 1, width // 5 + 1), np.uint8),
                   np.ones((5, 5), np.uint8))[top:height, :width]
    mask = np.ones((height, width), np.bool_)
    mask[top:] = False
    return [np.vstack([image[:top], hull]) for image in images], mask


@pytest.mark.parametrize('share', [0.05, 0.2])
def test_noise_beside_a_masked_hull_is_never_an_estimate(share: float):
    """The hull is alike in all frames, as they are: taken into account, it would speak for chance."""
    chance = np.random.default_rng(3)
    images, mask = with_hull([np.clip(110 + chance.standard_normal((540, 960)), 0, 255).astype(np.uint8)
                              for _ in range(15)], share)
    assert set(statuses(images, mask=mask)[1:]) <= {EgoStatus.DEGENERATE, EgoStatus.LOW_TEXTURE}


def test_a_masked_hull_does_not_speak_against_the_motion_of_a_scene_in_depth():
    """Bands that slide differently, so that the stabilised pair is looked at, over a hull that any warp moves."""
    chance = np.random.default_rng(5)
    bands = [np.kron(chance.integers(0, 256, (8, 160), np.uint8), np.ones((6, 6), np.uint8)) for _ in range(5)]
    images, mask = with_hull([np.vstack([band[:, (4 + 2 * depth) * index:(4 + 2 * depth) * index + 320]
                                         for band, depth in zip(bands, (0, 3, 1, 4, 2), strict=True)])
                              for index in range(12)], 0.45)
    found = statuses(images, mask=mask)[1:]
    assert found.count(EgoStatus.OK) >= 0.8 * len(found), found


@pytest.mark.parametrize('contrast', [6.0, 4.0])
def test_a_masked_hull_does_not_hold_the_ground_back(contrast: float):
    """Ground of little texture, of ``contrast`` grey levels, goes 3 px a frame to the left; features on the hull's edge
    would stand still, and half of all do.
    """
    chance = np.random.default_rng(6)
    ground = cv2.GaussianBlur(chance.standard_normal((540, 1100)), (0, 0), 15.0 if contrast < 5.0 else 20.0)
    ground = 110.0 + contrast * ground / ground.std()
    views = [ground[:, 3 * index:3 * index + 960] + chance.standard_normal((540, 960)) for index in range(15)]
    images, mask = with_hull([np.clip(view, 0, 255).astype(np.uint8) for view in views], 0.2)
    across = [ego.matrix[0] @ [480.0, 270.0, 1.0] - 480.0 for ego in motions(images, mask=mask)[1:] if ego.ok]
    assert len(across) >= 12
    assert np.median(across) == pytest.approx(-3.0, abs=0.15)


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
