"""A camera that stands still is recognised and cheap; one that drifts slowly is not mistaken for it."""

from __future__ import annotations

import time
from itertools import pairwise

import cv2
import numpy as np
import pytest
from scipy.ndimage import map_coordinates
from warps import HEIGHT, PERIOD_NS, WIDTH, about_centre, corner_error, world

from motion_detect_ros.core.config import EgoMotionConfig, PipelineConfig, PreprocessingConfig
from motion_detect_ros.core.ego_measured import Measured
from motion_detect_ros.core.ego_motion import EgoMotionStage
from motion_detect_ros.core.preprocessing import Preprocessor
from motion_detect_ros.core.still_camera import LOOK_BACK, StillFirst, patch_displacements, sampled
from motion_detect_ros.core.types import EgoMotion, EgoStatus, PreparedFrame

FRAMES = LOOK_BACK + 4
STEP = 0.05 / np.hypot(WIDTH / 2, HEIGHT / 2)  # moves the corners by 0.05 px


def moved(texture: np.ndarray, dx: float, dy: float) -> np.ndarray:
    """The picture moved exactly, by the shift theorem of the Fourier transform."""
    y, x = np.fft.fftfreq(texture.shape[0])[:, None], np.fft.fftfreq(texture.shape[1])[None]
    return np.fft.ifft2(np.fft.fft2(texture) * np.exp(-2j * np.pi * (x * dx + y * dy))).real


def seen(texture: np.ndarray, noise: float, seed: int) -> np.ndarray:
    inside = texture[160:160 + HEIGHT, 160:160 + WIDTH]
    noisy = inside + np.random.default_rng(seed).normal(0, noise, inside.shape)
    return np.clip(np.rint(noisy), 0, 255).astype(np.uint8)


def watch(pictures: list[np.ndarray], static_px: float = 0.05, **ego: object) -> list[EgoMotion]:
    config = PipelineConfig(ego_motion=EgoMotionConfig(static_px=static_px, **ego))
    stage, prepare = EgoMotionStage(config), Preprocessor(config.preprocessing)
    return [stage.process(prepare.process(picture, (index + 1) * PERIOD_NS)) for index, picture in enumerate(pictures)]


def still(estimates: list[EgoMotion]) -> list[bool]:
    """Where nothing but the identity came out."""
    return [ego.ok and bool(np.array_equal(ego.matrix, np.eye(3))) for ego in estimates]


@pytest.mark.parametrize('noise', [0.0, 1.0])
def test_a_still_camera_has_no_motion_after_a_while(noise):
    texture = world(2).astype(float)
    estimates = watch([seen(texture, noise, index) for index in range(FRAMES)], smoothing='none')
    assert estimates[0].status == EgoStatus.FIRST_FRAME
    assert all(ego.ok for ego in estimates[1:])
    assert np.mean(still(estimates[LOOK_BACK:])) > 0.8
    assert all(np.isfinite(ego.covariance).all() for ego in estimates[1:])


@pytest.mark.parametrize('angle', [0.0, 2.2])
@pytest.mark.parametrize(('drift', 'noise'), [(0.05, 0.0), (0.05, 1.0), (0.05, 4.0), (0.1, 0.0)])
def test_a_slow_drift_is_motion(drift, noise, angle):
    texture = world(1).astype(float)
    pictures = [seen(moved(texture, index * drift * np.cos(angle), index * drift * np.sin(angle)), noise, index)
                for index in range(FRAMES)]
    assert not any(still(watch(pictures, smoothing='none')))


@pytest.mark.parametrize('step', [about_centre(np.degrees(STEP), 1, 0, 0), about_centre(0, 1 + STEP, 0, 0)])
def test_a_slow_turn_and_a_slow_zoom_are_motion(step):
    texture, ahead, pictures = world(1).astype(np.float32), np.array([[1, 0, -160], [0, 1, -160], [0, 0, 1.0]]), []
    for index in range(FRAMES):
        warp = np.linalg.matrix_power(step, index) @ ahead
        x, y = np.meshgrid(np.arange(WIDTH), np.arange(HEIGHT))
        back = np.linalg.inv(warp) @ np.stack([x.ravel(), y.ravel(), np.ones(x.size)])
        pictures.append(seen(np.pad(bicubic(texture, back[0], back[1]).reshape(HEIGHT, WIDTH), 160), 0.5, index))
    assert not any(still(watch(pictures, smoothing='none')))


def test_a_drift_that_a_codec_shows_in_steps_is_motion():
    """Frames repeat and jump every fourth: from one to the next there is nothing to see, over eight there is."""
    texture = world(1).astype(float)
    prepare, config = Preprocessor(PreprocessingConfig()), EgoMotionConfig(static_px=0.05)
    frames = [prepare.process(seen(moved(texture, 0.2 * (index // 4), 0), 0, 0), index + 1)
              for index in range(FRAMES + 4)]
    asked = Asked()
    method = StillFirst(config, asked)
    for previous, frame in pairwise(frames):
        method.measure(previous, frame)
    assert asked.count == len(frames) - 1


class Asked:
    """A method that counts how often it is asked."""

    count = 0

    def measure(self, previous: PreparedFrame, frame: PreparedFrame, prior: np.ndarray | None = None) -> Measured:
        self.count += 1
        return Measured(None, EgoStatus.DEGENERATE, 0)


def test_a_still_camera_does_not_ask_the_method():
    prepare, texture, asked = Preprocessor(PreprocessingConfig()), world(2).astype(float), Asked()
    frames = [prepare.process(seen(texture, 0.5, index), index + 1) for index in range(FRAMES)]
    method = StillFirst(EgoMotionConfig(static_px=0.05), asked)
    for previous, frame in pairwise(frames):
        method.measure(previous, frame)
    assert LOOK_BACK - 1 <= asked.count <= LOOK_BACK + 1


def bicubic(image: np.ndarray, x: np.ndarray, y: np.ndarray) -> np.ndarray:
    return map_coordinates(image, [y, x], order=3)


def test_the_first_step_after_standing_is_seen():
    texture = world(3).astype(float)
    pictures = [seen(texture, 1.0, index) for index in range(FRAMES)] + [seen(moved(texture, 3.0, -2.0), 1.0, 99)]
    ego = watch(pictures, smoothing='none')[-1]
    assert corner_error(ego.matrix, about_centre(0, 1, 3.0, -2.0)) < 0.3


def test_a_return_to_the_earlier_view_is_motion():
    texture = world(3).astype(float)
    path = [0.0] * FRAMES + [4.0, 0.0]
    estimates = watch([seen(moved(texture, dx, 0), 1.0, index) for index, dx in enumerate(path)], smoothing='none')
    assert not any(still(estimates)[-2:])
    assert corner_error(estimates[-1].matrix, about_centre(0, 1, -4.0, 0)) < 0.3


def test_something_that_crosses_the_picture_leaves_the_camera_still():
    texture, other = world(2).astype(float), world(7).astype(float)
    pictures = []
    for index in range(FRAMES):
        scene = texture.copy()
        scene[260:460, 200 + 6 * index:400 + 6 * index] = other[200:400, 200:400]
        pictures.append(seen(scene, 0.5, index))
    assert np.mean(still(watch(pictures, smoothing='none'))[LOOK_BACK:]) > 0.8


def test_a_gap_or_a_masked_picture_is_left_to_the_method():
    flat = np.full((HEIGHT, WIDTH), 90, np.uint8)
    assert all(ego.status == EgoStatus.LOW_TEXTURE for ego in watch([flat] * FRAMES)[1:])
    config = PreprocessingConfig(ignore_regions=f'0,0,{WIDTH},{HEIGHT}')
    frame = Preprocessor(config).process(seen(world(2).astype(float), 0, 0), PERIOD_NS)
    assert len(patch_displacements(sampled(frame), sampled(frame))[0]) == 0


def test_displacements_of_patches_are_those_of_the_picture():
    texture = world(5).astype(float)
    prepare = Preprocessor(PreprocessingConfig())
    frames = [prepare.process(picture, index + 1) for index, picture in enumerate(
        [seen(texture, 0, 0), seen(moved(texture, 0.3, -0.2), 0, 0)])]
    _, shift = patch_displacements(*map(sampled, frames))
    np.testing.assert_allclose(np.median(shift, axis=0), [0.3, -0.2], atol=0.03)


def test_a_still_camera_is_cheap():
    pictures = [seen(world(2).astype(float), 0.5, index) for index in range(FRAMES + 6)]
    threads = cv2.getNumThreads()
    cv2.setNumThreads(1)

    def median_time(static_px: float) -> float:
        config = PipelineConfig(ego_motion=EgoMotionConfig(method='direct', static_px=static_px))
        stage, prepare, times = EgoMotionStage(config), Preprocessor(config.preprocessing), []
        for index, picture in enumerate(pictures):
            frame = prepare.process(picture, (index + 1) * PERIOD_NS)
            start = time.thread_time()
            stage.process(frame)
            times.append(time.thread_time() - start)
        return float(np.median(times[LOOK_BACK + 1:]))

    try:
        assert median_time(0.05) < 0.7 * median_time(0.0)
    finally:
        cv2.setNumThreads(threads)
