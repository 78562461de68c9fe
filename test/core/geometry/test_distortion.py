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
