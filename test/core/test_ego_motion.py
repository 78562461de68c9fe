"""Ego-motion against exact warps."""

from __future__ import annotations

import cv2
import numpy as np
import pytest

from motion_detect_ros.core.config import EgoMotionConfig, PipelineConfig
from motion_detect_ros.core.ego_motion import EgoMotionStage
from motion_detect_ros.core.preprocessing import Preprocessor
from motion_detect_ros.core.types import EgoStatus

WIDTH, HEIGHT, PERIOD_NS = 640, 480, 40_000_000
CORNERS = np.array([[0, 0, 1], [WIDTH - 1, 0, 1], [0, HEIGHT - 1, 1], [WIDTH - 1, HEIGHT - 1, 1]], float)


def world(seed: int, height: int = HEIGHT + 320, width: int = WIDTH + 320) -> np.ndarray:
    """Texture at several scales, band-limited so that resampling it is exact to well under a grey level."""
    random = np.random.default_rng(seed)
    layers = [cv2.resize(random.normal(size=(height // s + 2, width // s + 2)).astype(np.float32), (width, height),
                         interpolation=cv2.INTER_CUBIC) * s for s in (4, 8, 16, 32)]
    picture = cv2.GaussianBlur(sum(layers), (0, 0), 1.2)
    return cv2.normalize(picture, None, 0, 255, cv2.NORM_MINMAX).astype(np.uint8)


def view(texture: np.ndarray, matrix: np.ndarray) -> np.ndarray:
    """What the camera sees after the background moved by ``matrix`` (previous pixel -> current pixel)."""
    offset = np.array([[1, 0, -160], [0, 1, -160], [0, 0, 1]], float)  # world -> previous view
    return cv2.warpAffine(texture, (matrix @ offset)[:2], (WIDTH, HEIGHT), flags=cv2.INTER_LANCZOS4)


def about_centre(angle_deg: float, scale: float, dx: float, dy: float) -> np.ndarray:
    turn = cv2.getRotationMatrix2D((WIDTH / 2, HEIGHT / 2), angle_deg, scale)
    matrix = np.vstack([turn, [0, 0, 1]])
    matrix[:2, 2] += dx, dy
    return matrix


def estimate(previous: np.ndarray, current: np.ndarray, config: PipelineConfig | None = None):
    config = config or PipelineConfig()
    stage, prepare = EgoMotionStage(config), Preprocessor(config.preprocessing)
    stage.process(prepare.process(previous, PERIOD_NS))
    return stage.process(prepare.process(current, 2 * PERIOD_NS))


def corner_error(estimated: np.ndarray, true: np.ndarray) -> float:
    return float(np.linalg.norm(((CORNERS @ estimated.T) - (CORNERS @ true.T))[:, :2], axis=1).max())


@pytest.mark.parametrize(('kind', 'draw'), [
    ('translation', lambda r: (0, 1, r.uniform(-20, 20), r.uniform(-20, 20))),
    ('rotation', lambda r: (r.uniform(-10, 10), 1, 0, 0)),
    ('scale', lambda r: (0, r.uniform(0.9, 1.1), 0, 0)),
    ('all', lambda r: (r.uniform(-10, 10), r.uniform(0.9, 1.1), r.uniform(-20, 20), r.uniform(-20, 20))),
])
def test_known_warps_with_a_fifth_of_the_picture_moving_otherwise(kind, draw):
    errors = []
    for seed in range(12):
        random = np.random.default_rng(seed)
        matrix = about_centre(*draw(random))
        texture, other = world(seed), world(seed + 100, HEIGHT, WIDTH)
        previous, current = view(texture, np.eye(3)), view(texture, matrix)
        # outliers: a window of 20 % of the image that moves by 12 px against everything else
        w, h = round(WIDTH * 0.447), round(HEIGHT * 0.447)
        x, y = random.integers(20, WIDTH - w - 40), random.integers(20, HEIGHT - h - 40)
        previous[y:y + h, x:x + w] = other[y:y + h, x:x + w]
        current[y:y + h, x + 12:x + 12 + w] = other[y:y + h, x:x + w]
        ego = estimate(previous, current)
        assert ego.status == EgoStatus.OK
        errors.append(corner_error(ego.matrix, matrix))
    assert np.median(errors) <= 0.1, errors


def test_covariance_grows_with_the_noise_of_the_picture():
    texture, matrix = world(3), about_centre(1, 1.01, 3, -2)
    random = np.random.default_rng(0)
    covariances = []
    for sigma in (0.0, 20.0):
        pair = [np.clip(view(texture, m) + random.normal(0, sigma, (HEIGHT, WIDTH)), 0, 255).astype(np.uint8)
                for m in (np.eye(3), matrix)]
        covariances.append(np.trace(estimate(*pair).covariance[::3, ::3]))
    assert covariances[1] > 4 * covariances[0]


@pytest.mark.parametrize('picture', [np.zeros((HEIGHT, WIDTH), np.uint8), np.full((HEIGHT, WIDTH), 200, np.uint8)])
def test_nothing_to_see_is_said_and_not_guessed(picture):
    ego = estimate(picture, picture)
    assert ego.status == EgoStatus.LOW_TEXTURE
    np.testing.assert_array_equal(ego.matrix, np.eye(3))
    assert np.isnan(ego.covariance).all()


def test_first_frame_gap_backward_jump_and_new_size_are_labelled():
    config = PipelineConfig()
    stage, prepare = EgoMotionStage(config), Preprocessor(config.preprocessing)
    picture = view(world(1), np.eye(3))
    second = 1_000_000_000
    stamps = [(picture, 10 * second, EgoStatus.FIRST_FRAME), (picture, 10 * second + PERIOD_NS, EgoStatus.OK),
              (picture, 15 * second, EgoStatus.TIME_JUMP), (picture, 9 * second, EgoStatus.TIME_JUMP),
              (picture[:400], 9 * second + PERIOD_NS, EgoStatus.SIZE_CHANGE),
              (picture[:400], 9 * second + 2 * PERIOD_NS, EgoStatus.OK)]
    for image, stamp, expected in stamps:
        ego = stage.process(prepare.process(image, stamp))
        assert (ego.status, ego.stamp_ns) == (expected, stamp)
        if not ego.ok:
            np.testing.assert_array_equal(ego.matrix, np.eye(3))


def test_reset_makes_the_next_frame_the_first():
    stage, prepare = EgoMotionStage(PipelineConfig()), Preprocessor(PipelineConfig().preprocessing)
    frame = prepare.process(view(world(1), np.eye(3)), PERIOD_NS)
    stage.process(frame)
    stage.reset()
    assert stage.process(frame).status == EgoStatus.FIRST_FRAME


def test_shrinking_the_picture_keeps_full_resolution_units():
    matrix = about_centre(2, 1.02, 9, -6)
    config = PipelineConfig(preprocessing=type(PipelineConfig().preprocessing)(max_width_px=320))
    ego = estimate(view(world(5), np.eye(3)), view(world(5), matrix), config)
    assert corner_error(ego.matrix, matrix) < 0.3


def test_smoothing_off_gives_the_raw_fit():
    matrix = about_centre(1, 1.0, 4, 4)
    config = PipelineConfig(ego_motion=EgoMotionConfig(smoothing='none'))
    ego = estimate(view(world(6), np.eye(3)), view(world(6), matrix), config)
    assert corner_error(ego.matrix, matrix) < 0.1
