"""Parallax of raised points, against an exact projection."""

from __future__ import annotations

import cv2
import numpy as np
import pytest

from motion_detect_ros.core.trajectories.parallax import back_by_travel, fitted_homography, without_parallax
from motion_detect_ros.core.types import CameraModel

CAMERA = CameraModel(640, 360, 560.0, 560.0, 319.5, 179.5)
PITCH = np.radians(50.0)


@pytest.fixture
def random() -> np.random.Generator:
    return np.random.default_rng(4)


def project(world: np.ndarray, camera_m: np.ndarray, turned: np.ndarray) -> np.ndarray:
    """(N, 2) pixels of points right, ahead, up; the camera looks ahead and down, and has turned from there."""
    right, ahead, up = (world - camera_m).T
    seen = np.stack([right, -up * np.cos(PITCH) - ahead * np.sin(PITCH), ahead * np.cos(PITCH) - up * np.sin(PITCH)])
    x, y, z = CAMERA.matrix @ turned @ seen
    return np.stack([x / z, y / z], axis=1)


def scene(height_m: np.ndarray, random: np.random.Generator) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Points at these heights before and after the camera has travelled and turned, and after it had only turned."""
    world = np.column_stack([random.uniform(-15, 15, len(height_m)), random.uniform(20, 45, len(height_m)), height_m])
    start, turn = np.array([0.0, 0.0, 40.0]), cv2.Rodrigues(np.array([0.01, -0.02, 0.03]))[0]
    return (project(world, start, np.eye(3)), project(world, start + np.array([2.0, 1.0, 0.2]), turn),
            project(world, start, turn))


def mapped(matrix: np.ndarray, points: np.ndarray) -> np.ndarray:
    return cv2.perspectiveTransform(points[None], matrix)[0]


def test_the_way_back_leads_to_where_a_camera_that_only_turned_sees_the_plane(random: np.random.Generator) -> None:
    earlier, now, turned = scene(np.zeros(300), random)
    homography = fitted_homography(earlier.astype(np.float32), now)
    assert homography is not None
    np.testing.assert_allclose(mapped(homography, earlier), now, atol=1e-3)
    back = back_by_travel(homography, earlier.astype(np.float32), CAMERA)
    np.testing.assert_allclose(mapped(back, now), turned, atol=0.02)
    assert np.linalg.norm(now - turned, axis=1).min() > 10.0


def test_there_is_no_way_back_from_what_is_no_homography() -> None:
    points = np.zeros((10, 2), np.float32)
    for homography in (None, np.zeros((3, 3)), np.full((3, 3), np.nan)):
        np.testing.assert_array_equal(back_by_travel(homography, points, CAMERA), np.eye(3))


def test_parallax_explains_what_raised_points_do(random: np.random.Generator) -> None:
    earlier, now, _ = scene(np.zeros(300), random)
    homography = fitted_homography(earlier.astype(np.float32), now)
    back = back_by_travel(homography, earlier.astype(np.float32), CAMERA)
    before, after, _ = scene(np.full(200, 5.0), random)
    error = after - mapped(homography, before)
    unexplained, noise = np.empty((2, 200))
    without_parallax(after.astype(np.float32), error, back, unexplained, noise)
    assert np.linalg.norm(error, axis=1).min() > 1.0
    assert np.median(unexplained) < 0.1


def test_what_is_left_is_the_error_less_a_limited_share_of_the_shift(random: np.random.Generator) -> None:
    places = (random.random((400, 2)) * [640, 360]).astype(np.float32)
    back = np.array([[1.01, 0.02, -7.0], [-0.01, 0.99, 3.0], [1e-5, 2e-5, 1.0]])
    error = random.normal(0.0, 4.0, (400, 2))
    shift = places - mapped(back, places.astype(float))
    share = np.clip(np.einsum('ij,ij->i', error, shift) / np.einsum('ij,ij->i', shift, shift), -0.05, 0.5)
    unexplained, noise = np.empty((2, 400))
    without_parallax(places, error, back, unexplained, noise)
    np.testing.assert_allclose(unexplained, np.linalg.norm(error - share[:, None] * shift, axis=1), atol=1e-5)
    np.testing.assert_allclose(noise, 0.1 * np.linalg.norm(share[:, None] * shift, axis=1), atol=1e-5)
    assert {-0.05, 0.5} < set(share.tolist())


def test_without_travel_nothing_is_explained(random: np.random.Generator) -> None:
    error, unexplained, noise = random.normal(0.0, 4.0, (50, 2)), np.empty(50), np.empty(50)
    without_parallax((random.random((50, 2)) * 300).astype(np.float32), error, np.eye(3), unexplained, noise)
    np.testing.assert_allclose(unexplained, np.linalg.norm(error, axis=1), rtol=1e-12)
    np.testing.assert_array_equal(noise, 0.0)
