"""Points followed into the next image: against the known warp, and against OpenCV's own search of the whole pyramid."""

from __future__ import annotations

import cv2
import numpy as np
import pytest
from warps import HEIGHT, WIDTH, about_centre, corner_error, estimate, view, world

from motion_detect_ros.core.config import EgoMotionConfig, PipelineConfig
from motion_detect_ros.core.ego_motion.features import find_features
from motion_detect_ros.core.ego_motion.point_tracking import track_points
from motion_detect_ros.core.ego_motion.stage import EgoMotionStage
from motion_detect_ros.core.preprocessing.stage import Preprocessor

CONFIG = EgoMotionConfig()
SHIFT = about_centre(1.0, 1.0, 7.0, -4.0)


def corners(picture: np.ndarray) -> np.ndarray:
    return find_features('shi_tomasi', picture, CONFIG.max_corners, CONFIG.corner_quality)


def through(matrix: np.ndarray, points: np.ndarray) -> np.ndarray:
    return points @ matrix[:2, :2].T + matrix[:2, 2]


def searched(previous: np.ndarray, current: np.ndarray, points: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """The whole pyramid, both ways, from no guess."""
    options = {'winSize': (CONFIG.lk_window_px,) * 2, 'maxLevel': CONFIG.pyramid_levels}
    moved, there, _ = cv2.calcOpticalFlowPyrLK(previous, current, points, None, **options)
    back, again, _ = cv2.calcOpticalFlowPyrLK(current, previous, moved, None, **options)
    near = np.linalg.norm(back - points, axis=1) < CONFIG.forward_backward_px
    return moved, (there.ravel() > 0) & (again.ravel() > 0) & near


@pytest.mark.parametrize('dx', [0.0, 40.0, -45.0])
def test_as_many_and_as_exact_as_the_search_of_the_whole_pyramid(dx):
    texture, matrix = world(2), about_centre(0.5, 1.01, dx, 9.0)
    previous, current = view(texture, np.eye(3)), view(texture, matrix)
    points = corners(previous)
    moved, good, _ = track_points(previous, current, points, CONFIG)
    searched_for, expected = searched(previous, current, points)
    assert good.sum() >= 0.97 * expected.sum() > 100
    errors = np.linalg.norm([moved, searched_for] - through(matrix, points), axis=2)
    assert np.median(errors[0, good]) < 1.05 * np.median(errors[1, expected])
    assert (errors[0, good] < 1.0).mean() > 0.97


def test_a_jump_between_calm_frames_is_followed_at_once():
    texture, stage = world(4), EgoMotionStage(PipelineConfig(ego_motion=EgoMotionConfig(smoothing='none')))
    prepare = Preprocessor(PipelineConfig().preprocessing)
    at = np.eye(3)
    for index, dx in enumerate((0.0, 0.5, 40.0, 0.5)):
        step = about_centre(0.0, 1.0, dx, 0.0)
        at = step @ at
        ego = stage.process(prepare.process(view(texture, at), 40_000_000 * (index + 1)))
        if index:
            assert corner_error(ego.matrix, step) < 0.1, dx


def moved_apart(steps_px: tuple[int, ...]) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Earlier and later view, and (N, 2) points of the earlier one: a band of it for each step to the right."""
    previous, current = view(world(1), np.eye(3)), view(world(1), np.eye(3))
    height = HEIGHT // len(steps_px)
    for index, step in enumerate(steps_px):
        band = np.s_[index * height:(index + 1) * height]
        current[band] = np.roll(previous[band], step, axis=1)
    return previous, current, corners(previous)


def test_where_no_motion_is_that_of_most_points_all_are_followed():
    previous, current, points = moved_apart((-32, 0, 32))
    band = (points[:, 1] // (HEIGHT // 3)).astype(int)
    inner = (np.abs(points[:, 0] - WIDTH / 2) < 200) & (np.abs(points[:, 1] % (HEIGHT // 3) - HEIGHT / 6) < 60)
    moved, good, error = track_points(previous, current, points, CONFIG)
    for number, step in enumerate((-32.0, 0.0, 32.0)):
        these = inner & (band == number)
        followed = np.linalg.norm(moved - points - [step, 0.0], axis=1)[these & good] < 0.5
        assert followed.sum() > 0.8 * these.sum() > 30
        assert np.median(error[these & good]) < 2.0  # where they are, not where they were looked for first


def test_points_with_another_motion_than_most_are_let_go():
    """A pyramid for them alone costs as much as for hundreds, and the camera's motion needs none of them."""
    previous, current, points = moved_apart((0, 0, 32))
    inner = (np.abs(points[:, 0] - WIDTH / 2) < 200) & (np.abs(points[:, 1] % (HEIGHT // 3) - HEIGHT / 6) < 60)
    other = points[:, 1] > 2 * HEIGHT / 3
    _, good, _ = track_points(previous, current, points, CONFIG)
    assert good[inner & other].mean() < 0.3
    assert good[inner & ~other].mean() > 0.95


def test_hidden_points_do_not_survive_the_way_back():
    hidden = survived = 0
    for seed in range(6):
        previous, current = view(world(seed), np.eye(3)), view(world(seed), SHIFT)
        current[140:340, 180:460] = world(seed + 50, HEIGHT, WIDTH)[140:340, 180:460]
        points = corners(previous)
        there = through(SHIFT, points)
        behind = ((there > [190, 150]) & (there < [450, 330])).all(axis=1)
        _, good, _ = track_points(previous, current, points, CONFIG)
        hidden, survived = hidden + behind.sum(), survived + (good & behind).sum()
    assert hidden > 500 and survived < 0.05 * hidden


def test_a_repeated_pattern_does_not_lead_to_its_neighbour():
    y, x = np.mgrid[:HEIGHT, :WIDTH].astype(np.float64)

    def pattern(matrix: np.ndarray) -> np.ndarray:
        u, v = np.moveaxis(through(np.linalg.inv(matrix), np.stack([x, y], axis=-1)), -1, 0)
        return (128 + 50 * np.sin(2 * np.pi * u / 16) * np.sin(2 * np.pi * v / 16)).astype(np.uint8)

    previous, current = (cv2.addWeighted(view(world(3), m), 0.3, pattern(m), 0.7, 0) for m in (np.eye(3), SHIFT))
    points = corners(previous)
    moved, good, _ = track_points(previous, current, points, CONFIG)
    assert good.mean() > 0.9
    assert np.linalg.norm(moved - through(SHIFT, points), axis=1)[good].max() < 1.0


@pytest.mark.parametrize('angle', [4.0, 9.0])
def test_turned_patches_are_measured_on_the_turned_picture(angle):
    matrix = about_centre(angle, 1.03, 10.0, 5.0)
    ego = estimate(view(world(7), np.eye(3)), view(world(7), matrix))
    assert corner_error(ego.matrix, matrix) < 0.03


def test_few_points_need_no_scouts():
    previous, current = view(world(5), np.eye(3)), view(world(5), SHIFT)
    points = corners(previous)[::40].copy()
    moved, good, _ = track_points(previous, current, points, CONFIG)
    _, expected = searched(previous, current, points)
    np.testing.assert_array_equal(good, expected)
    assert np.abs(moved - through(SHIFT, points))[good].max() < 0.5
