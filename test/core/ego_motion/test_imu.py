"""Integrated angular rates against attitudes in closed form and against pinhole geometry written out here."""

from __future__ import annotations

import numpy as np
import pytest

from motion_detect_ros.core.config import ImuConfig
from motion_detect_ros.core.ego_motion.alternatives.imu import GyroBuffer, rotation_homography
from motion_detect_ros.core.types import CameraModel

MS = 1_000_000
CAMERA = CameraModel(640, 480, 500.0, 520.0, 319.5, 239.5)


def filled(rate_at, stop_ms: float, step_ms: float = 5.0, config: ImuConfig | None = None) -> GyroBuffer:
    """A buffer with ``rate_at(seconds)`` sampled from time 0 on."""
    buffer = GyroBuffer(config or ImuConfig())
    for time_ms in np.arange(0.0, stop_ms + 1e-9, step_ms):
        buffer.add(round(time_ms * MS), rate_at(time_ms / 1e3))
    return buffer


def precession(time_s: float, turn: float = 2.0, nod: float = 3.0) -> tuple[np.ndarray, np.ndarray]:
    """Attitude Rz(turn t) Rx(nod t), and its body rate in closed form."""
    c, s = np.cos(turn * time_s), np.sin(turn * time_s)
    cx, sx = np.cos(nod * time_s), np.sin(nod * time_s)
    attitude = np.array([[c, -s, 0], [s, c, 0], [0, 0, 1]]) @ np.array([[1, 0, 0], [0, cx, -sx], [0, sx, cx]])
    return attitude, np.array([nod, turn * sx, turn * cx])


def test_turning_rates_give_the_rotation_in_closed_form():
    buffer = filled(lambda t: precession(t)[1], 300)
    before, after = precession(0.0513)[0], precession(0.2129)[0]  # neither coincides with a sample
    np.testing.assert_allclose(buffer.rotation(51_300_000, 212_900_000), after.T @ before, atol=2e-5)


def test_a_camera_that_turns_right_sees_things_go_left():
    buffer = filled(lambda _: np.array([0.0, 1.0, 0.0]), 40)  # about y, which points down
    rotation = buffer.rotation(0, 40 * MS)
    matrix = rotation_homography(rotation, CAMERA)
    seen = matrix @ [CAMERA.cx, CAMERA.cy, 1.0]
    np.testing.assert_allclose(seen[:2] / seen[2], [CAMERA.cx - CAMERA.fx * np.tan(0.04), CAMERA.cy], atol=1e-9)


def test_a_vehicle_s_axes_are_turned_into_the_camera_s():
    """IMU with x ahead, y left, z up: a left turn is +z, and things ahead go right; nose down is +y, things go up."""
    config = ImuConfig(roll_rad=np.pi / 2, pitch_rad=-np.pi / 2)
    for rate, direction in (([0.0, 0.0, 0.5], [1.0, 0.0]), ([0.0, 0.5, 0.0], [0.0, -1.0])):
        buffer = filled(lambda _, rate=rate: np.array(rate), 40, config=config)
        seen = rotation_homography(buffer.rotation(0, 40 * MS), CAMERA) @ [CAMERA.cx, CAMERA.cy, 1.0]
        moved = seen[:2] / seen[2] - [CAMERA.cx, CAMERA.cy]
        np.testing.assert_allclose(moved, np.array(direction) * [CAMERA.fx, CAMERA.fy] * np.tan(0.02), atol=1e-9)


@pytest.mark.parametrize('angles', [(0.3, 0.0, 0.0), (0.0, 0.3, 0.0), (0.0, 0.0, 0.3), (0.2, -0.4, 1.1)])
def test_mounting_angles_are_about_fixed_axes_x_then_y_then_z(angles):
    r, p, y = angles
    about_x = np.array([[1, 0, 0], [0, np.cos(r), -np.sin(r)], [0, np.sin(r), np.cos(r)]])
    about_y = np.array([[np.cos(p), 0, np.sin(p)], [0, 1, 0], [-np.sin(p), 0, np.cos(p)]])
    about_z = np.array([[np.cos(y), -np.sin(y), 0], [np.sin(y), np.cos(y), 0], [0, 0, 1]])
    rate = np.array([0.5, -1.0, 2.0])
    mounted = filled(lambda _: rate, 40, config=ImuConfig(roll_rad=r, pitch_rad=p, yaw_rad=y))
    straight = filled(lambda _: about_z @ about_y @ about_x @ rate, 40)
    np.testing.assert_allclose(mounted.rotation(0, 40 * MS), straight.rotation(0, 40 * MS), atol=1e-12)


def test_the_time_offset_moves_samples_to_the_camera_s_clock():
    late = GyroBuffer(ImuConfig(time_offset_s=0.1))
    for time_ms in range(-100, 201, 5):  # stamps 100 ms behind the camera's
        late.add(time_ms * MS, precession((time_ms + 100) / 1e3)[1])
    expected = precession(0.12)[0].T @ precession(0.08)[0]
    np.testing.assert_allclose(late.rotation(80 * MS, 120 * MS), expected, atol=2e-5)


@pytest.mark.parametrize(('present', 'known'), [
    (lambda t: True, True),
    (lambda t: False, False),
    (lambda t: t < 100, False),             # ends 100 ms before the later picture
    (lambda t: t < 160, True),              # the last rate lasts for 40 ms
    (lambda t: t > 200, False),             # begins after
    (lambda t: t < 110 or t > 170, False),  # a hole of 60 ms
    (lambda t: t < 130 or t > 170, True),   # a hole of 40 ms
    (lambda t: t < 10 or t > 300, False),   # the pictures lie in the hole
])
def test_holes_over_the_limit_give_nothing(present, known):
    buffer = GyroBuffer(ImuConfig(max_gap_s=0.05))
    for time_ms in range(0, 401, 5):
        if present(time_ms):
            buffer.add(time_ms * MS, np.array([0.0, 1.0, 0.0]))
    rotation = buffer.rotation(100 * MS, 200 * MS)
    assert (rotation is not None) == known
    if known:
        np.testing.assert_allclose(rotation[0, 2], -np.sin(0.1), atol=1e-9)


def test_broken_samples_are_left_out_and_an_earlier_stamp_begins_anew():
    buffer = GyroBuffer(ImuConfig())
    for time_ms in range(0, 101, 5):
        buffer.add(time_ms * MS, np.array([0.0, 0.0, 1.0]))
        buffer.add(time_ms * MS + 1, np.array([0.0, np.nan, 1.0]))
        buffer.add(time_ms * MS + 2, np.zeros(2))
        buffer.add(time_ms * MS + 3, np.array([0.0, 0.0, 1e300]))
        buffer.add(time_ms * MS + 4, np.array([0.0, -1001.0, 1.0]))
    np.testing.assert_allclose(buffer.rotation(0, 100 * MS)[0, 1], np.sin(0.1), atol=1e-9)
    buffer.add(5 * MS, np.array([0.0, 0.0, -1.0]))
    np.testing.assert_allclose(buffer.rotation(0, 100 * MS)[0, 1], -np.sin(0.1), atol=1e-9)
    buffer.reset()
    assert buffer.rotation(0, 100 * MS) is None


def test_a_driver_that_repeats_a_stamp_loses_nothing():
    buffer = GyroBuffer(ImuConfig())
    for time_ms in range(0, 101, 5):
        for _ in range(2):
            buffer.add(time_ms * MS, np.array([0.0, 0.0, 1.0]))
    np.testing.assert_allclose(buffer.rotation(0, 100 * MS)[0, 1], np.sin(0.1), atol=1e-9)


def test_no_time_and_backward_time_give_nothing():
    buffer = filled(lambda _: np.array([0.0, 1.0, 0.0]), 100)
    assert buffer.rotation(50 * MS, 50 * MS) is None
    assert buffer.rotation(50 * MS, 40 * MS) is None


def test_consecutive_pictures_chain_to_the_whole_turn():
    buffer = filled(lambda t: precession(t)[1], 2000)
    whole = np.eye(3)
    for start in range(0, 1960, 40):
        whole = buffer.rotation(start * MS, (start + 40) * MS) @ whole
    np.testing.assert_allclose(whole, precession(1.96)[0].T, atol=2e-4)


def test_the_homography_is_that_of_rays_turned_by_hand():
    rotation = precession(0.05)[0].T
    ray = rotation @ [(100.0 - CAMERA.cx) / CAMERA.fx, (400.0 - CAMERA.cy) / CAMERA.fy, 1.0]
    expected = [CAMERA.fx * ray[0] / ray[2] + CAMERA.cx, CAMERA.fy * ray[1] / ray[2] + CAMERA.cy]
    seen = rotation_homography(rotation, CAMERA) @ [100.0, 400.0, 1.0]
    np.testing.assert_allclose(seen[:2] / seen[2], expected, rtol=1e-12)


def test_a_turn_out_of_sight_has_no_homography():
    quarter = np.array([[0.0, 0.0, -1.0], [0.0, 1.0, 0.0], [1.0, 0.0, 0.0]])
    assert rotation_homography(quarter, CAMERA) is None
    assert rotation_homography(np.diag([-1.0, 1.0, -1.0]), CAMERA) is None
