"""Bearings worked by hand."""

from __future__ import annotations

import math

import numpy as np
import pytest

from motion_detect_ros.core.geometry.bearings import bearings
from motion_detect_ros.core.types import CameraModel, empty_detections


def bearing(camera: CameraModel, u: float, v: float) -> list[float]:
    """Of a box around the centre of pixel (u, v)."""
    records = empty_detections(1)
    records['u'], records['v'] = u + 0.5, v + 0.5  # the box's edges count from the edge of the picture
    found = bearings(records, camera)
    return [float(found[f'bearing_{axis}'][0]) for axis in 'xyz']


class TestBearings:
    CAMERA = CameraModel(640, 480, 400.0, 400.0, 320.0, 240.0)

    #: Triangles of sides 3, 4, 5 and 1, 2, 2, 3.
    @pytest.mark.parametrize(('pixel', 'ray'), [
        ((320, 240), (0, 0, 1)), ((620, 240), (0.6, 0, 0.8)), ((20, 240), (-0.6, 0, 0.8)), ((320, -60), (0, -0.6, 0.8)),
        ((720, 440), (2 / 3, 1 / 3, 2 / 3)), ((520, 640), (1 / 3, 2 / 3, 2 / 3)),
    ])
    def test_worked_by_hand(self, pixel, ray):
        assert bearing(self.CAMERA, *pixel) == pytest.approx(ray, abs=1e-6)

    def test_angles_off_the_axis(self):
        camera = CameraModel(1000, 800, 500.0, 250.0, 480.0, 410.0)
        x, y, z = bearing(camera, 480 + 500 * math.tan(math.radians(30)), 410)
        assert (math.degrees(math.atan2(x, z)), y) == (pytest.approx(30.0, abs=1e-4), pytest.approx(0.0, abs=1e-6))
        x, y, z = bearing(camera, 480, 410 - 250 * math.tan(math.radians(50)))
        assert (math.degrees(math.atan2(y, z)), x) == (pytest.approx(-50.0, abs=1e-4), pytest.approx(0.0, abs=1e-6))

    def test_the_projection_of_a_point_leads_back_to_its_direction(self):
        camera, random = CameraModel(960, 540, 700.0, 710.0, 470.0, 280.0), np.random.default_rng(2)
        for point in random.uniform((-20, -10, 5), (20, 10, 80), (50, 3)):
            image = np.array([[700.0, 0, 470.0], [0, 710.0, 280.0], [0, 0, 1]]) @ point
            ray = bearing(camera, *(image[:2] / image[2]))
            assert ray == pytest.approx(point / np.linalg.norm(point), abs=1e-5)

    def test_the_same_scene_read_out_at_half_the_size(self):
        # pixel centres at whole numbers: 700 of the full picture is (700 + 0.5) / 2 - 0.5 = 349.75 of the half
        assert bearing(self.CAMERA.resized(320, 240), 349.75, 99.75) == pytest.approx(
            bearing(self.CAMERA, 700, 200), abs=1e-6)

    def test_unknown_without_calibration(self):
        records = bearings(empty_detections(2), None)
        assert all(np.isnan(records[f'bearing_{axis}']).all() for axis in 'xyz')

    def test_a_box_of_one_pixel_on_the_principal_point_is_straight_ahead(self):
        """Box from edge to edge of pixel (320, 240): left 320, right 321, hence centre 320.5."""
        records = empty_detections(1)
        records['u'], records['v'], records['width'], records['height'] = 320.5, 240.5, 1.0, 1.0
        found = bearings(records, self.CAMERA)
        assert [float(found[f'bearing_{axis}'][0]) for axis in 'xyz'] == [0.0, 0.0, 1.0]
