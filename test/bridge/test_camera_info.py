"""CameraInfo as a pinhole camera: which matrix holds, and what region of interest and binning make of it."""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np
import pytest
from sensor_msgs.msg import CameraInfo, RegionOfInterest
from std_msgs.msg import Header

from motion_detect_ros.bridge.images import camera_to_msg
from motion_detect_ros.core.types import CameraModel
from motion_detect_ros.sources import messages
from motion_detect_ros.sources.bags import BagFrames, BagWriter
from motion_detect_ros.sources.camera_info import camera_of

HEADER = Header(frame_id='eye')


def test_camera_info_prefers_the_rectified_matrix_and_zero_is_uncalibrated():
    camera = CameraModel(640, 480, 500.0, 510.0, 320.5, 240.5)
    assert camera_of(camera_to_msg(camera, 640, 480, HEADER)) == camera
    info = CameraInfo(width=640, height=480, k=[1.0, 0, 2.0, 0, 3.0, 4.0, 0, 0, 1.0])
    assert camera_of(info) == CameraModel(640, 480, 1.0, 3.0, 2.0, 4.0)
    assert camera_of(camera_to_msg(None, 640, 480, HEADER)) is None


@pytest.mark.parametrize('k', [(math.nan, 5e2, 320, 240), (5e2, math.inf, 320, 240), (5e2, 5e2, math.nan, 240),
                               (1e-9, 5e2, 320, 240), (-5e2, 5e2, 320, 240)])
def test_what_no_calibration_can_be_is_uncalibrated(k: tuple[float, float, float, float]):
    fx, fy, cx, cy = (float(value) for value in k)
    assert camera_of(CameraInfo(width=640, height=480, k=[fx, 0.0, cx, 0.0, fy, cy, 0.0, 0.0, 1.0])) is None


def test_only_rectified_images_have_the_projection_of_the_rectified_camera():
    info = CameraInfo(width=640, height=480, k=[1.0, 0, 2.0, 0, 3.0, 4.0, 0, 0, 1.0],
                      p=[5.0, 0, 6.0, 0, 0, 7.0, 8.0, 0, 0, 0, 1.0, 0])
    assert camera_of(info) == CameraModel(640, 480, 1.0, 3.0, 2.0, 4.0)
    assert camera_of(info, rectified=True) == CameraModel(640, 480, 5.0, 7.0, 6.0, 8.0)
    info.p = [0.0] * 12
    assert camera_of(info, rectified=True) == CameraModel(640, 480, 1.0, 3.0, 2.0, 4.0)


def sensor(**fields: object) -> CameraInfo:
    """1600 x 1200, f = 800 px, centre (800, 600); its rectified images f = 600 px, centre (790, 610)."""
    return CameraInfo(width=1600, height=1200, k=[800.0, 0, 800.0, 0, 800.0, 600.0, 0, 0, 1.0],
                      p=[600.0, 0, 790.0, 0, 0, 600.0, 610.0, 0, 0, 0, 1.0, 0], **fields)


def pixel(camera: CameraModel | None, point: tuple[float, float, float]) -> tuple[float, float]:
    x, y, z = point
    return camera.fx * x / z + camera.cx, camera.fy * y / z + camera.cy


@pytest.mark.parametrize(('fields', 'size', 'at'), [
    # The point (1, -0.5, 4) m is at (800 + 200, 600 - 100) = (1000, 500) on the sensor.
    ({}, (1600, 1200), (1000.0, 500.0)),
    # The window's first pixel is (400, 300): 600 pixels further right, 200 further down.
    ({'roi': RegionOfInterest(x_offset=400, y_offset=300, width=1000, height=600)}, (1000, 600), (600.0, 200.0)),
    # Pixel 0 holds the sensor's 0 and 1, centre 0.5: pixel 500 has its centre at 1000.5, so 1000 is at 499.75.
    ({'binning_x': 2, 'binning_y': 2}, (800, 600), (499.75, 249.75)),
    # Column 0 holds 400 to 403, centre 401.5: 1000 lies 598.5 / 4 = 149.625 columns on; rows are not combined.
    ({'roi': RegionOfInterest(x_offset=400, y_offset=300, width=1000, height=600), 'binning_x': 4, 'binning_y': 1},
     (250, 600), (149.625, 200.0)),
], ids=['whole', 'window', 'binned', 'window binned across'])
def test_a_point_by_hand_is_where_the_published_image_has_it(fields, size, at):
    camera = camera_of(sensor(**fields))
    assert (camera.width, camera.height) == size
    assert pixel(camera, (1.0, -0.5, 4.0)) == pytest.approx(at)


def test_the_rectified_matrix_is_of_the_whole_sensor_too():
    """(1, -0.5, 4) m: (790 + 150, 610 - 75) = (940, 535) there, (540, 235) in the window, 539.5 / 2 and 234.5 / 2."""
    window = RegionOfInterest(x_offset=400, y_offset=300, width=1000, height=600)
    camera = camera_of(sensor(roi=window, binning_x=2, binning_y=2), rectified=True)
    assert (camera.width, camera.height) == (500, 300)
    assert pixel(camera, (1.0, -0.5, 4.0)) == pytest.approx((269.75, 117.25))


def test_bags_are_read_with_window_and_binning(tmp_path: Path):
    info = messages.camera_info(CameraModel(1600, 1200, 800.0, 800.0, 800.0, 600.0), 0, 'eye')
    info.binning_x = info.binning_y = 4
    info.roi.x_offset, info.roi.y_offset, info.roi.width, info.roi.height = 400, 300, 256, 192
    with BagWriter(tmp_path / 'a.mcap') as writer:
        writer.write('/camera_info', info, 0)
        writer.write_image(np.zeros((48, 64), np.uint8), 0)
    assert BagFrames(tmp_path / 'a.mcap').camera == CameraModel(
        64, 48, 200.0, 200.0, 400.5 / 4 - 0.5, 300.5 / 4 - 0.5)


@pytest.mark.parametrize('lens', [
    {'distortion': (-0.3, 0.1, 0.001, 0.002, 0.0)}, {'distortion': (0.1,) * 8},
    {'distortion': (0.1, 0.02, 0.003, 0.0004), 'fisheye': True}])
def test_lens_and_own_size_survive_the_message(lens):
    camera = CameraModel(320, 240, 200.0, 201.0, 160.0, 120.0, **lens)
    info = camera_to_msg(camera, 160, 120, HEADER)
    assert camera_of(info) == camera
    assert (info.width, info.height) == (320, 240), 'that of the calibration, so that the receiver sees what is wrong'
    assert camera_of(camera_to_msg(CameraModel(0, 0, 200.0, 201.0, 80.0, 60.0), 160, 120, HEADER)).width == 160
