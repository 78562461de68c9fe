"""Ego-motion against exact warps."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from warps import (
    DRAWS,
    HEIGHT,
    PERIOD_NS,
    WIDTH,
    about_centre,
    corner_error,
    estimate,
    view,
    with_a_mover,
    world,
)

from motion_detect_ros.core.config import EgoMotionConfig, PipelineConfig
from motion_detect_ros.core.ego_motion.measurement import centre_of, is_plausible
from motion_detect_ros.core.ego_motion.robust_fit import MotionFit
from motion_detect_ros.core.ego_motion.stage import EgoMotionStage
from motion_detect_ros.core.geometry.frame_history import FrameHistory
from motion_detect_ros.core.preprocessing.stage import Preprocessor
from motion_detect_ros.core.types import EgoMotion, EgoStatus, MotionModel, PreparedFrame


@pytest.mark.parametrize('kind', DRAWS)
def test_known_warps_with_a_fifth_of_the_picture_moving_otherwise(kind):
    errors = []
    for seed in range(12):
        previous, current, matrix = with_a_mover(kind, seed)
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


def of_each(pictures: list[np.ndarray], **settings: str) -> list[EgoMotion]:
    config = PipelineConfig(ego_motion=EgoMotionConfig(**settings))
    stage, prepare = EgoMotionStage(config), Preprocessor(config.preprocessing)
    return [stage.process(prepare.process(each, (index + 1) * PERIOD_NS)) for index, each in enumerate(pictures)]


@pytest.mark.parametrize(('method', 'smoothing'), [
    ('indirect', 'kalman'), ('indirect', 'autoregressive'), ('flow', 'kalman'), ('direct', 'kalman')])
def test_a_camera_in_gusts_is_followed_in_every_frame(method: str, smoothing: str):
    """Jerked by 6 px and half a degree in any direction, from frame to frame: no smooth motion foretells it."""
    random, texture = np.random.default_rng(2), world(7)
    poses = [np.eye(3)] * 5 + [about_centre(random.normal(0.0, 0.5), 1.0, *random.normal(0.0, 6.0, 2))
                               for _ in range(25)]
    found = of_each([view(texture, pose) for pose in poses], method=method, smoothing=smoothing)
    assert {each.status for each in found[1:]} == {EgoStatus.OK}
    errors = [corner_error(each.matrix, after @ np.linalg.inv(before))
              for each, before, after in zip(found[1:], poses, poses[1:], strict=False)]
    assert np.max(errors[5:]) < 1.0


@pytest.mark.parametrize('smoothing', ['kalman', 'autoregressive'])
def test_what_covers_most_of_the_picture_for_a_moment_is_not_the_ground(smoothing: str):
    """Something jumps by 60 px in front of two thirds of a ground that passes steadily."""
    texture, other = world(8), world(9, HEIGHT, WIDTH)
    pictures = [view(texture, about_centre(0.0, 1.0, 3.0 * index, 0.0)) for index in range(14)]
    for index, shift in ((11, 0), (12, 60)):
        pictures[index][:, 60 + shift:480 + shift] = other[:, :420]
    found = of_each(pictures, smoothing=smoothing)
    assert {each.status for each in found[1:11]} == {EgoStatus.OK}
    assert found[12].status == EgoStatus.OUTLIER_GATED
    before = next(each for each in reversed(found[:12]) if each.ok)
    assert found[12].prev_stamp_ns == before.stamp_ns, 'it says what it was compared with'
    assert found[12].tracks > 0


@pytest.mark.parametrize('step_px', [12, 20, 30])
def test_what_passes_in_front_for_two_frames_is_not_the_ground_in_either(step_px: int):
    """With a rule for the motion; as much acceleration as the Kalman filter expects would go as far."""
    texture, other = world(8), world(9, HEIGHT, WIDTH)
    pictures = [view(texture, about_centre(0.0, 1.0, 3.0 * index, 0.0)) for index in range(18)]
    for index in (11, 12, 13):
        shift = 60 + step_px * (index - 11)
        pictures[index][:, shift:shift + 420] = other[:, :420]
    found = of_each(pictures, smoothing='autoregressive')
    assert [each.status for each in found[12:14]] == [EgoStatus.OUTLIER_GATED] * 2
    for each, index in zip(found[1:], range(1, 18), strict=True):
        if each.ok:
            frames = round((each.stamp_ns - each.prev_stamp_ns) / PERIOD_NS)
            assert corner_error(each.matrix, about_centre(0.0, 1.0, 3.0 * frames, 0.0)) < 1.0, index


def test_what_the_mask_hides_does_not_tell_against_a_jerk_of_the_camera():
    """The hull in view stands still, as a camera at rest would show it."""
    poses = [np.eye(3)] * 8 + [about_centre(0.0, 1.0, 30.0 * (-1) ** index, 5.0) for index in range(6)]
    hull, config = np.zeros((HEIGHT, WIDTH), bool), PipelineConfig(ego_motion=EgoMotionConfig())
    hull[:, WIDTH * 55 // 100:] = True
    stage, prepare = EgoMotionStage(config), Preprocessor(config.preprocessing)
    still = world(9, HEIGHT, WIDTH)
    for index, pose in enumerate(poses):
        picture = np.where(hull, still, view(world(7), pose)).astype(np.uint8)
        ego = stage.process(replace(prepare.process(picture, (index + 1) * PERIOD_NS), mask=~hull))
        assert ego.ok or not index, index


DAMAGED = {
    'grey': lambda picture: np.full_like(picture, 128),
    'noise': lambda picture: np.random.default_rng(int(picture.sum())).integers(0, 256, picture.shape, np.uint8),
    'another scene': lambda picture: view(world(30), np.eye(3)),
}


def passing(count: int, texture: np.ndarray) -> list[np.ndarray]:
    return [view(texture, about_centre(0.2 * index, 1.0, 3.0 * index, -1.5 * index)) for index in range(count)]


@pytest.mark.parametrize('smoothing', ['kalman', 'autoregressive', 'none'])
@pytest.mark.parametrize('damage', DAMAGED.values(), ids=DAMAGED)
@pytest.mark.parametrize('wrong', [[6], [6, 7], [6, 7, 8, 10]], ids=['one', 'two', 'four'])
def test_damaged_pictures_cost_only_themselves(damage, wrong: list[int], smoothing: str):
    """The motion into the first good one after them is that from the last good one before."""
    pictures = passing(14, world(11))
    for index in wrong:
        pictures[index] = damage(pictures[index])
    found = of_each(pictures, smoothing=smoothing)
    if damage is DAMAGED['another scene'] and len(wrong) > 1:
        found, wrong = found[:7], wrong[:1]  # from its second picture on it is the scene
    last = 0
    for index, ego in enumerate(found[1:], start=1):
        assert ego.passed_over == (index in wrong), index
        if index not in wrong:
            assert ego.prev_stamp_ns == (last + 1) * PERIOD_NS
            steps = [about_centre(0.2 * each, 1.0, 3.0 * each, -1.5 * each) for each in (last, index)]
            assert corner_error(ego.matrix, steps[1] @ np.linalg.inv(steps[0])) < 0.3
            last = index


@pytest.mark.parametrize('smoothing', ['kalman', 'autoregressive'])
@pytest.mark.parametrize('count', [1, 2, 4])
def test_damaged_pictures_do_not_make_the_filter_forget(monkeypatch, count: int, smoothing: str):
    """Nor does the second of them, which is compared with the first one, too: there may have been a cut."""
    pictures, forgotten = passing(14, world(11)), []
    for index in range(6, 6 + count):
        pictures[index] = DAMAGED['grey'](pictures[index])
    forget = EgoMotionStage._forget
    monkeypatch.setattr(EgoMotionStage, '_forget', lambda self: (forgotten.append(1), forget(self))[1])
    assert [each.ok for each in of_each(pictures, smoothing=smoothing)].count(False) == 1 + count
    assert len(forgotten) == 1, 'at the start'
    assert len(of_each(passing(5, world(11)) + passing(5, world(31)), smoothing=smoothing)) == 10
    assert len(forgotten) == 3, 'at the next start, and at a cut'


def test_after_a_cut_the_motion_is_that_of_the_new_scene_from_its_second_picture_on():
    found = of_each(passing(5, world(11)) + passing(5, world(31)))
    assert [each.ok for each in found] == [False, True, True, True, True, False, True, True, True, True]
    assert [each.prev_stamp_ns // PERIOD_NS for each in found[6:]] == [6, 7, 8, 9]


def test_blindness_for_longer_than_a_gap_starts_from_the_last_picture():
    """1.2 s of grey at 25 Hz, then the scene again."""
    pictures = passing(4, world(11)) + [np.full((HEIGHT, WIDTH), 90, np.uint8)] * 30 + passing(3, world(11))
    found = of_each(pictures)
    assert all(each.status == EgoStatus.LOW_TEXTURE for each in found[4:34])
    assert [each.ok for each in found[34:]] == [False, True, True]
    assert found[35].prev_stamp_ns == 35 * PERIOD_NS


@pytest.mark.parametrize('angle_deg', [5.0, 10.0, 20.0])
def test_inliers_are_some_of_the_tracks(angle_deg: float):
    """A turn is measured a second time on the warped picture, with more tracks than came through the first time."""
    for seed in range(3):
        texture = world(seed)
        ego = estimate(view(texture, np.eye(3)), view(texture, about_centre(angle_deg, 1.0, 0.0, 0.0)))
        assert ego.status == EgoStatus.OK and 0 < ego.inliers <= ego.tracks


@pytest.mark.parametrize('baseline_s', [0.04, 0.12, 0.4])
def test_after_a_cut_frames_are_compared_from_the_second_picture_on(baseline_s: float):
    config, history = PipelineConfig(), FrameHistory(baseline_s)
    stage, prepare = EgoMotionStage(config), Preprocessor(config.preprocessing)
    known = []
    for index, picture in enumerate(passing(14, world(11)) + passing(14, world(31))):
        frame = prepare.process(picture, (index + 1) * PERIOD_NS)
        known.append(history.step(frame, stage.process(frame)) is not None)
    assert known == [False] + 13 * [True] + [False] + 13 * [True]


def test_the_centre_is_that_of_the_full_resolution():
    frame = PreparedFrame(np.zeros((180, 320), np.uint8), 0.5, 640, 360, 0)
    assert centre_of(frame).tolist() == [320.0, 180.0]


@pytest.mark.parametrize(('changes', 'plausible'), [
    ({}, True), ({'inliers': 9}, False), ({'inliers': 10}, True),
    # of any parameter, the standard deviation may be 5 px
    ({'variance': 24.9}, True), ({'variance': 25.1}, False), ({'variance': np.nan}, False),
    # A is in pixels half the diagonal, 500 px, from the centre: 200 are 1.4 times the size, determinant 1.96
    ({'scale_px': 200.0}, True), ({'scale_px': 210.0}, False),
    ({'scale_px': -145.0}, True), ({'scale_px': -150.0}, False),  # 0.71^2 = 0.504, 0.7^2 = 0.49
])
def test_a_fit_of_few_points_uncertain_or_of_a_leap_in_size_is_no_camera_motion(changes: dict, plausible: bool):
    given = {'inliers': 12, 'variance': 0.01, 'scale_px': 0.0, **changes}
    theta, covariance = np.zeros(8), 0.01 * np.eye(8)
    theta[[1, 5]], covariance[4, 4] = given['scale_px'], given['variance']
    fit = MotionFit(theta, covariance, np.arange(40) < given['inliers'], 0.1, MotionModel.AFFINE)
    assert is_plausible(fit, np.array([400.0, 300.0])) == plausible
    assert not is_plausible(None, np.array([400.0, 300.0]))
