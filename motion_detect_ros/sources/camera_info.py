"""sensor_msgs/CameraInfo as a camera model, whatever library has read the message."""

from __future__ import annotations

import math
from dataclasses import replace
from typing import Any

from motion_detect_ros.core.types import CameraModel

#: Names of the model of wide lenses, and of polynomials of the radius (the latter with so many coefficients).
FISHEYE, POLYNOMIALS = ('equidistant', 'fisheye'), ('plumb_bob', 'rational_polynomial', '')
COUNTS, PLUMB_BOB = (4, 5, 8, 12, 14), 5


def camera_of(info: Any, rectified: bool = False) -> CameraModel | None:
    """The camera of the published image; None where it is uncalibrated (all zero, or no calibration can be so).

    Matrix K and distortion D (plumb_bob, rational_polynomial, equidistant) for images as the sensor gives them;
    ``rectified``: matrix P, where there is one, for images from which the distortion has been removed (REP 104). Both
    matrices are of the whole sensor at full resolution; the image is its region of interest (roi, all 0 = all of it),
    each pixel the mean of binning_x x binning_y (0 = 1). Pixel centres sit at whole numbers: x of the image = (x of
    the sensor - x_offset + 0.5) / binning_x - 0.5.
    """
    p, k, roi = info.p, info.k, info.roi
    fx, fy, cx, cy = (p[0], p[5], p[2], p[6]) if rectified and p[0] else (k[0], k[4], k[2], k[5])
    across, down = max(1, int(info.binning_x)), max(1, int(info.binning_y))
    camera = CameraModel.of(
        int(roi.width or info.width) // across, int(roi.height or info.height) // down, float(fx) / across,
        float(fy) / down, _binned(float(cx) - roi.x_offset, across), _binned(float(cy) - roi.y_offset, down))
    return camera if camera is None or rectified else replace(camera, **_lens(info))


def distortion_model_of(camera: CameraModel) -> str:
    """The name that sensor_msgs/CameraInfo has for the lens of a camera."""
    if camera.fisheye:
        return FISHEYE[0]
    return 'plumb_bob' if len(camera.distortion) <= PLUMB_BOB else 'rational_polynomial'


def lens_problem(info: Any) -> str:
    """Why the distortion of a message is left out; empty where it is used, or there is none."""
    given = [float(value) for value in info.d]
    if not any(given):
        return ''
    if info.distortion_model not in FISHEYE + POLYNOMIALS:
        return ('distortion_model: expected plumb_bob, rational_polynomial or equidistant, '
                f'got {info.distortion_model!r}')
    most = 4 if info.distortion_model in FISHEYE else COUNTS[-1]
    if len(given) > most or not all(map(math.isfinite, given)):
        return (f'D: expected up to {most} finite coefficients, got {len(given)}: '
                f'{", ".join(f"{value:g}" for value in given)}')
    return ''


def _lens(info: Any) -> dict[str, Any]:
    """``distortion`` and ``fisheye`` of a camera; no distortion where the message tells none that OpenCV knows.

    D all zero is no distortion with every model, equidistant too, as ROS's image_geometry takes it.
    """
    given, fisheye = [float(value) for value in info.d], info.distortion_model in FISHEYE
    if not any(given) or lens_problem(info):
        return {}
    count = next(each for each in ((4,) if fisheye else COUNTS) if each >= len(given))
    return {'distortion': (*given, *[0.0] * (count - len(given))), 'fisheye': fisheye}


def _binned(position: float, pixels: int) -> float:
    return (position + 0.5) / pixels - 0.5
