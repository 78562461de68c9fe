"""Lenses against OpenCV's own projections of points in space."""

from __future__ import annotations

import cv2
import numpy as np
import pytest
from sensor_msgs.msg import CameraInfo

from motion_detect_ros.core.geometry.bearings import bearings
from motion_detect_ros.core.geometry.distortion import distorted, undistorted
from motion_detect_ros.core.types import CameraModel, empty_detections
from motion_detect_ros.sources.camera_info import camera_of

MATRIX = np.array([[300.0, 0.0, 320.5], [0.0, 310.0, 241.0], [0.0, 0.0, 1.0]])
#: Model, coefficients, how far from the axis, tangent of the angle.
LENSES = {
    'none': ('plumb_bob', (), 1.2),
    'plumb_bob': ('plumb_bob', (-0.31, 0.11, 0.001, -0.0005, -0.02), 1.0),
    'rational': ('rational_polynomial', (0.6, 0.1, 0.0005, 0.0002, 0.01, 0.95, 0.2, 0.02), 1.5),
    'equidistant': ('equidistant', (0.05, -0.01, 0.002, -0.0004), 3.0),
}


def seen(name: str) -> tuple[np.ndarray, np.ndarray, CameraModel]:
    """Rays all over the picture, the pixels they are seen at, and the camera as a message tells it."""
    model, lens, reach = LENSES[name]
    plane = np.stack(np.meshgrid(np.linspace(-reach, reach, 13), np.linspace(-0.7 * reach, 0.7 * reach, 9)), -1)
    rays = np.c_[plane.reshape(-1, 2), np.ones(13 * 9)]
    project = cv2.fisheye.projectPoints if name == 'equidistant' else cv2.projectPoints
    pixels, _ = project(rays.reshape(-1, 1, 3), np.zeros(3), np.zeros(3), MATRIX, np.array(lens) if lens else None)
    info = CameraInfo(width=640, height=480, distortion_model=model, d=list(lens), k=list(MATRIX.ravel()))
    return rays, pixels.reshape(-1, 2), camera_of(info)


@pytest.mark.parametrize('name', LENSES)
def test_pixels_and_rays(name: str):
    rays, pixels, camera = seen(name)
    np.testing.assert_allclose(undistorted(pixels, camera), rays[:, :2], atol=1e-6)
    np.testing.assert_allclose(distorted(rays[:, :2].copy(), camera), pixels, atol=1e-6)


@pytest.mark.parametrize('name', LENSES)
def test_bearings_point_to_what_is_seen_at_any_size_of_the_picture(name: str):
    rays, pixels, camera = seen(name)
    for share in (1.0, 0.5):
        records = empty_detections(len(rays))
        records['u'], records['v'] = (pixels + 0.5).T * share  # of edges of pixels
        found = bearings(records, camera.resized(round(640 * share), round(480 * share)))
        directions = np.stack([found[f'bearing_{axis}'] for axis in 'xyz'], -1)
        wanted = rays / np.linalg.norm(rays, axis=1, keepdims=True)
        assert np.degrees(np.arccos(np.clip((directions * wanted).sum(axis=1), -1.0, 1.0))).max() < 0.05


def test_rectified_images_have_no_distortion_and_unknown_coefficients_are_none():
    info = CameraInfo(width=640, height=480, distortion_model='plumb_bob', d=[0.1] * 5, k=list(MATRIX.ravel()))
    assert camera_of(info, rectified=True).distortion == ()
    info.d = [0.1, float('nan'), 0.0, 0.0]
    assert camera_of(info).distortion == ()
    info.d = [0.1] * 15
    assert camera_of(info).distortion == ()
    info.d = [0.1] * 3
    assert camera_of(info).distortion == (0.1, 0.1, 0.1, 0.0)


def directions(camera: CameraModel, pixels: np.ndarray) -> np.ndarray:
    """(N, 3) bearings of boxes around pixels, which are counted from their centres."""
    records = empty_detections(len(pixels))
    records['u'], records['v'] = (pixels + 0.5).T
    found = bearings(records, camera)
    return np.stack([found[f'bearing_{axis}'] for axis in 'xyz'], -1)


def test_there_is_no_bearing_at_right_angles_to_the_axis_and_beyond():
    """An ideal wide lens, r = f * angle, of 204 degrees: 1.57 rad are 283 px from the axis."""
    camera = CameraModel(640, 480, 180.0, 180.0, 320.0, 240.0, (0.0, 0.0, 0.0, 0.0), True)
    radius = np.array([0.0, 100.0, 200.0, 270.0, 285.0, 300.0, 318.0])
    found = directions(camera, np.c_[320.0 + radius, np.full(7, 240.0)])
    angle = radius / 180.0
    np.testing.assert_allclose(found[:4], np.c_[np.sin(angle), np.zeros(7), np.cos(angle)][:4], atol=2e-3)
    assert np.isnan(found[4:]).all()


def test_there_is_no_bearing_where_the_polynomial_of_a_lens_turns_back():
    """Its image ends where r = angle * (1 - 0.35 * angle^2) is largest, at 0.976 rad: 320 * 0.65 = 208 px."""
    camera = CameraModel(640, 480, 320.0, 320.0, 320.0, 240.0, (-0.35, 0.0, 0.0, 0.0), True)
    found = directions(camera, np.array([[320.0 + 150.0, 240.0], [320.0 + 200.0, 240.0], [320.0 + 230.0, 240.0],
                                         [320.0 + 300.0, 240.0]]))
    assert np.isfinite(found[:2]).all() and (found[:2, 2] > 0.5).all()
    assert np.isnan(found[2:]).all()


@pytest.mark.parametrize('name', LENSES)
def test_there_is_a_bearing_all_over_the_picture_of_a_lens_that_fits_it(name: str):
    _, pixels, camera = seen(name)
    assert np.isfinite(directions(camera, pixels)).all()
