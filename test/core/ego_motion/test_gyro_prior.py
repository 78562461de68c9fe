"""Ego-motion with a gyroscope: views of a rotating camera, drawn by the exact homography of the rotation."""

from __future__ import annotations

from dataclasses import replace
from itertools import pairwise

import cv2
import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from motion_detect_ros.core.config import EgoMotionConfig, ImuConfig, PipelineConfig
from motion_detect_ros.core.ego_motion.alternatives.gyro_prior import GyroPrior
from motion_detect_ros.core.ego_motion.stage import EgoMotionStage
from motion_detect_ros.core.pipeline import MotionPipeline
from motion_detect_ros.core.preprocessing.stage import Preprocessor
from motion_detect_ros.core.types import CameraModel, EgoMotion, EgoStatus, MotionModel, PreparedFrame

WIDTH, HEIGHT, PERIOD_NS, SAMPLE_NS, MARGIN = 480, 360, 40_000_000, 2_000_000, 400
CAMERA = CameraModel(WIDTH, HEIGHT, 400.0, 400.0, 239.5, 179.5)
K = np.array([[400.0, 0, 239.5], [0, 400.0, 179.5], [0, 0, 1]])
CORNERS = np.array([[0, 0], [WIDTH - 1, 0], [0, HEIGHT - 1], [WIDTH - 1, HEIGHT - 1]], np.float64)


def wall(seed: int = 0) -> np.ndarray:
    """Fine texture far away, larger than the view."""
    random = np.random.default_rng(seed)
    size = (HEIGHT + 2 * MARGIN, WIDTH + 2 * MARGIN)
    noise = cv2.GaussianBlur(random.normal(size=size).astype(np.float32), (0, 0), 1.6)
    return np.clip(128 + 40 * noise / noise.std(), 0, 255).astype(np.uint8)


def rates(time_s: float, speed: float) -> np.ndarray:
    """Pan and tilt that come and go, with a little roll: up to ``speed`` rad/s."""
    return speed * np.array([0.3 * np.sin(9 * time_s), np.cos(12 * time_s), 0.15 * np.sin(5 * time_s)])


def attitudes(speed: float, frames: int, steps: int = 2000) -> list[np.ndarray]:
    """World-from-camera at each frame: the rates integrated in far finer steps than the gyroscope's samples."""
    attitude, found = Rotation.identity(), [np.eye(3)]
    for index in range(frames - 1):
        fine_s = PERIOD_NS * 1e-9 / steps
        times = index * PERIOD_NS * 1e-9 + (np.arange(steps) + 0.5) * fine_s
        for turn in Rotation.from_rotvec(np.array([rates(t, speed) for t in times]) * fine_s):
            attitude *= turn
        found.append(attitude.as_matrix())
    return found


def homography(before: np.ndarray, after: np.ndarray) -> np.ndarray:
    """A direction d of the world is seen at K attitude^T d."""
    return K @ after.T @ before @ np.linalg.inv(K)


def view(texture: np.ndarray, attitude: np.ndarray) -> np.ndarray:
    shift = np.array([[1, 0, -MARGIN], [0, 1, -MARGIN], [0, 0, 1.0]])
    return cv2.warpPerspective(
        texture, homography(np.eye(3), attitude) @ shift, (WIDTH, HEIGHT), flags=cv2.INTER_CUBIC)


def seen(matrix: np.ndarray, points: np.ndarray = CORNERS) -> np.ndarray:
    return cv2.perspectiveTransform(points[None], matrix)[0]


def corner_error(ego: EgoMotion, true: np.ndarray) -> float:
    return float(np.linalg.norm(seen(ego.matrix) - seen(true), axis=1).max())


def config_for(imu: ImuConfig, **ego: object) -> PipelineConfig:
    return PipelineConfig(imu=imu, ego_motion=EgoMotionConfig(smoothing='none', model='homography', **ego))


def fly(
    pictures: list[np.ndarray], config: PipelineConfig, speed: float, camera: CameraModel | None = CAMERA,
) -> list[EgoMotion]:
    """Every picture after the samples up to it, on the stage."""
    stage, prepare, sample_ns = EgoMotionStage(config, camera), Preprocessor(config.preprocessing), 0
    estimates = []
    for index, picture in enumerate(pictures):
        while sample_ns <= index * PERIOD_NS + SAMPLE_NS:
            stage.add_gyro(sample_ns, rates(sample_ns * 1e-9, speed))
            sample_ns += SAMPLE_NS
        estimates.append(stage.process(prepare.process(picture, index * PERIOD_NS)))
    return estimates[1:]


def errors(estimates: list[EgoMotion], poses: list[np.ndarray]) -> list[float]:
    """Corner error of every pair, infinite where there is no estimate."""
    return [corner_error(ego, homography(before, after)) if ego.ok else np.inf
            for ego, before, after in zip(estimates, poses, poses[1:], strict=False)]


@pytest.fixture(scope='module')
def fast() -> tuple[float, list[np.ndarray], list[np.ndarray]]:
    """Speed, attitudes and views; steps of 25 to 100 px a frame."""
    speed, texture = 6.0, wall()
    poses = attitudes(speed, 6, 200)
    return speed, poses, [view(texture, pose) for pose in poses]


def test_fast_turns_are_followed_with_the_prior_and_lost_without(fast):
    speed, poses, pictures = fast
    centre = np.array([[239.5, 179.5]])
    steps = [np.linalg.norm(seen(homography(a, b), centre) - centre) for a, b in pairwise(poses)]
    assert min(steps) > 25
    without = errors(fly(pictures, config_for(ImuConfig()), speed), poses)
    helped = errors(fly(pictures, config_for(ImuConfig(use=True)), speed), poses)
    assert np.median(without) > 20, without
    assert max(helped) < 0.3, helped


def test_the_wrong_time_offset_is_worse_than_the_right_one(fast):
    speed, poses, pictures = fast
    blank = [np.full((HEIGHT, WIDTH), 90, np.uint8)] * len(pictures)
    found = {offset: np.median(errors(fly(blank, config_for(ImuConfig(use=True, time_offset_s=offset)), speed), poses))
             for offset in (-0.02, -0.01, 0.0, 0.01, 0.02)}
    assert min(found, key=found.get) == 0.0
    assert found[0.0] < 0.02
    assert found[0.02] > found[0.01] > 1.0 and found[-0.02] > found[-0.01] > 1.0


def test_pictures_that_show_nothing_get_the_gyroscope_s_homography(fast):
    speed, poses, _ = fast
    blank = [np.full((HEIGHT, WIDTH), 90, np.uint8)] * len(poses)
    estimates = fly(blank, config_for(ImuConfig(use=True)), speed)
    for ego, before, after in zip(estimates, poses, poses[1:], strict=False):
        assert (ego.status, ego.model, ego.inliers) == (EgoStatus.OK, MotionModel.HOMOGRAPHY, 0)
        assert corner_error(ego, homography(before, after)) < 0.02
        assert ego.prev_stamp_ns == ego.stamp_ns - PERIOD_NS


def test_rates_since_a_damaged_picture_start_anew_from_it(monkeypatch, fast):
    """They do not tell what was before, so that the filter would add up motions with a gap between them."""
    speed, _, pictures = fast
    config, forgotten, forget = config_for(ImuConfig(use=True)), [], EgoMotionStage._forget
    monkeypatch.setattr(EgoMotionStage, '_forget', lambda self: (forgotten.append(1), forget(self))[1])
    stage, prepare = EgoMotionStage(config, CAMERA), Preprocessor(config.preprocessing)
    blank, estimates = np.full((HEIGHT, WIDTH), 90, np.uint8), []
    for index, picture in enumerate([pictures[0], *[blank] * 9]):
        if index == 9:
            for sample_ns in range(8 * PERIOD_NS - SAMPLE_NS, 9 * PERIOD_NS + SAMPLE_NS + 1, SAMPLE_NS):
                stage.add_gyro(sample_ns, rates(sample_ns * 1e-9, speed))
        estimates.append(stage.process(prepare.process(picture, index * PERIOD_NS)))
    assert [each.ok for each in estimates] == 9 * [False] + [True]
    assert estimates[-1].prev_stamp_ns == 8 * PERIOD_NS
    assert len(forgotten) == 2, 'at the start, and there'


def test_its_covariance_is_the_spread_of_noisy_rates():
    """300 recordings with a constant error of the rate: squared Mahalanobis distances average to three degrees."""
    config = ImuConfig(use=True, noise_rad_s=0.02)
    frames = [PreparedFrame(np.zeros((HEIGHT, WIDTH), np.uint8), 1.0, WIDTH, HEIGHT, stamp) for stamp in (0, PERIOD_NS)]
    random, rate, found = np.random.default_rng(0), np.array([0.5, 1.0, -0.4]), []
    for trial in range(300):
        prior = GyroPrior(config)
        error = random.normal(0, 0.02, 3) if trial else np.zeros(3)
        for stamp in range(0, PERIOD_NS + 1, SAMPLE_NS):
            prior.add(stamp, rate + error)
        found.append(prior.between(*frames, CAMERA))
    centre, step = np.array([WIDTH / 2, HEIGHT / 2]), 1e-3

    def affine_part(matrix: np.ndarray) -> np.ndarray:
        """Value and slopes of the warp at the centre, by differences, as a0..a5 about the origin."""
        at, right, down = seen(matrix, centre + step * np.array([[0, 0], [1, 0], [0, 1.0]]))
        slopes = np.column_stack([right - at, down - at]) / step - np.eye(2)
        shift = at - centre - slopes @ centre
        return np.array([shift[0], *slopes[0], shift[1], *slopes[1]])

    deviations = np.array([affine_part(prior.matrix) - affine_part(found[0].matrix) for prior in found[1:]])
    inverse = np.linalg.pinv(found[0].covariance, rcond=1e-9)
    assert np.linalg.matrix_rank(found[0].covariance, tol=1e-12) == 3
    assert np.mean(np.einsum('ni,ij,nj->n', deviations, inverse, deviations)) == pytest.approx(3.0, rel=0.2)


@pytest.mark.parametrize(('imu', 'camera', 'samples'), [
    (ImuConfig(use=True), CAMERA, False), (ImuConfig(use=True), None, True), (ImuConfig(), CAMERA, True)])
def test_without_samples_calibration_or_wish_all_is_as_without_gyroscope(imu, camera, samples):
    texture = wall()
    pictures = [view(texture, pose) for pose in attitudes(0.2, 3, 50)]
    plain = fly(pictures, config_for(ImuConfig()), 0.2, None)
    if samples:
        tried = fly(pictures, config_for(imu), 0.2, camera)
    else:
        stage, prepare = EgoMotionStage(config_for(imu), camera), Preprocessor(PipelineConfig().preprocessing)
        tried = [stage.process(prepare.process(p, i * PERIOD_NS)) for i, p in enumerate(pictures)][1:]
    for one, other in zip(plain, tried, strict=True):
        np.testing.assert_array_equal(one.matrix, other.matrix)


def test_a_camera_of_another_size_is_resized():
    speed = 1.0
    poses = attitudes(speed, 2, 50)
    blank = [np.full((HEIGHT, WIDTH), 90, np.uint8)] * 2
    twice = CAMERA.resized(2 * WIDTH, 2 * HEIGHT)
    ego = fly(blank, config_for(ImuConfig(use=True)), speed, twice)[0]
    assert corner_error(ego, homography(*poses)) < 0.02


def test_the_pipeline_hands_rates_on_and_reset_forgets_them():
    config = replace(PipelineConfig(), imu=ImuConfig(use=True))
    pipeline, blank = MotionPipeline(config, CAMERA), np.full((HEIGHT, WIDTH), 90, np.uint8)
    for stamp in range(0, 3 * PERIOD_NS, SAMPLE_NS):
        pipeline.add_gyro(stamp, np.array([0.0, 1.0, 0.0]))
    pipeline.process(blank, 0)
    ego = pipeline.process(blank, PERIOD_NS).ego
    moved = seen(ego.matrix, np.array([[239.5, 179.5]]))[0]
    np.testing.assert_allclose(moved, [239.5 - 400 * np.tan(0.04), 179.5], atol=1e-3)
    pipeline.reset()
    pipeline.process(blank, 2 * PERIOD_NS)
    assert pipeline.process(blank, 3 * PERIOD_NS).ego.status == EgoStatus.LOW_TEXTURE
