"""Which camera_info an image is measured with."""

from __future__ import annotations

import sys
import threading

import pytest
from sensor_msgs.msg import CameraInfo
from std_msgs.msg import Header

from motion_detect_ros.bridge.images import stamp_of
from motion_detect_ros.sources.calibration import KEPT, UNCALIBRATED, USED, Calibration

SIZE = 640, 480


def info(stamp_ns: int, focal_px: float) -> CameraInfo:
    return CameraInfo(header=Header(stamp=stamp_of(stamp_ns)), width=SIZE[0], height=SIZE[1],
                      k=[focal_px, 0.0, 320.0, 0.0, focal_px, 240.0, 0.0, 0.0, 1.0])


def zooming(count: int) -> Calibration:
    """After camera_info of so many images, 1 ns apart, of focal lengths 501, 502, ... px."""
    calibration = Calibration(rectified=False)
    for stamp_ns in range(1, count + 1):
        calibration.note(info(stamp_ns, 500.0 + stamp_ns))
    return calibration


def focal_px(calibration: Calibration, stamp_ns: int) -> float | None:
    camera = calibration.for_image(stamp_ns, *SIZE)
    return camera and camera.fx


def test_an_image_that_waited_has_its_own_and_not_the_latest():
    calibration = zooming(30)
    assert [focal_px(calibration, stamp_ns) for stamp_ns in (3, 4, 30)] == [503.0, 504.0, 530.0]


@pytest.mark.parametrize('stamp_ns', [31, 0, 1000])
def test_an_image_without_its_own_has_the_latest(stamp_ns: int):
    assert focal_px(zooming(30), stamp_ns) == 530.0


def test_old_ones_are_forgotten():
    calibration = zooming(KEPT + 1)
    assert focal_px(calibration, 1) == 500.0 + KEPT + 1
    assert focal_px(calibration, 2) == 502.0


def test_one_without_a_calibration_is_that_of_its_image_only_while_others_come():
    calibration = zooming(2)
    calibration.note(info(3, 0.0))
    calibration.note(info(4, 504.0))
    assert (focal_px(calibration, 3), calibration.state) == (None, UNCALIBRATED)
    assert (focal_px(calibration, 4), calibration.state) == (504.0, USED)
    calibration.note(info(5, 0.0))
    assert (focal_px(calibration, 6), calibration.state) == (None, UNCALIBRATED)


@pytest.mark.parametrize(('model', 'd', 'problem'), [
    ('fov', [0.93], "distortion_model: expected plumb_bob, rational_polynomial or equidistant, got 'fov'"),
    ('double_sphere', [0.6, -0.2],
     "distortion_model: expected plumb_bob, rational_polynomial or equidistant, got 'double_sphere'"),
    ('plumb_bob', [0.1, float('nan')], 'D: expected up to 14 finite coefficients, got 2: 0.1, nan'),
    ('equidistant', [0.1] * 5, 'D: expected up to 4 finite coefficients, got 5: 0.1, 0.1, 0.1, 0.1, 0.1')])
def test_a_lens_that_is_unknown_is_left_out_and_said(model: str, d: list[float], problem: str):
    lens = info(1, 500.0)
    lens.distortion_model, lens.d = model, d
    calibration = Calibration(rectified=False)
    calibration.note(lens)
    camera = calibration.for_image(1, *SIZE)
    assert camera is not None
    assert (camera.fx, camera.distortion, camera.fisheye) == (500.0, (), False)
    assert calibration.state == f'used without distortion, which is refused ({problem})'
    assert calibration.complaint() == f'camera_info {calibration.state}'
    assert calibration.complaint() == ''


@pytest.mark.parametrize(('model', 'd', 'rectified'), [
    ('fov', [0.93], True), ('fov', [0.0], False), ('plumb_bob', [0.1] * 5, False), ('', [0.1] * 4, False)])
def test_a_lens_that_is_known_or_does_not_matter_is_not_mentioned(model: str, d: list[float], rectified: bool):
    lens = info(1, 500.0)
    lens.distortion_model, lens.d = model, d
    calibration = Calibration(rectified)
    calibration.note(lens)
    calibration.for_image(1, *SIZE)
    assert (calibration.state, calibration.complaint()) == (USED, '')


def test_where_the_clock_goes_back_those_of_later_times_do_not_count_any_more():
    """A bag that begins again, or another camera: the clock showed 10 to 19 s, and shows 5 s now."""
    calibration = Calibration(rectified=False)
    for second in range(10, 20):
        calibration.note(info(second * 10**9, 500.0))
    calibration.note(info(5 * 10**9, 900.0))
    assert [focal_px(calibration, round(second * 1e9)) for second in (5.0, 9.9, 10.0, 10.1, 15.0, 30.0)] == [900.0] * 6


def test_one_that_comes_late_takes_none_away():
    calibration = zooming(30)
    calibration.note(info(10, 700.0))
    assert [focal_px(calibration, stamp_ns) for stamp_ns in (9, 10, 11, 30)] == [509.0, 700.0, 511.0, 530.0]


def test_they_may_come_while_an_image_asks_for_its_own():
    """The executor notes them, the thread of the stage asks."""
    calibration, faults, over = zooming(KEPT), list[BaseException](), threading.Event()

    def ask() -> None:
        try:
            while not over.is_set():
                for stamp_ns in range(KEPT + 1000, KEPT + 1100):
                    calibration.for_image(stamp_ns, *SIZE)
        except BaseException as error:
            faults.append(error)

    thread, interval = threading.Thread(target=ask), sys.getswitchinterval()
    sys.setswitchinterval(1e-6)
    try:
        thread.start()
        for stamp_ns in range(KEPT + 1, KEPT + 600):
            calibration.note(info(stamp_ns, 500.0))
    finally:
        over.set()
        thread.join()
        sys.setswitchinterval(interval)
    assert not faults
