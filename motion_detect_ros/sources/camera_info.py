"""sensor_msgs/CameraInfo as a pinhole camera, whatever library has read the message."""

from __future__ import annotations

from typing import Any

from motion_detect_ros.core.types import CameraModel


def camera_of(info: Any, rectified: bool = False) -> CameraModel | None:
    """Pinhole model of the published image; None where it is uncalibrated (all zero, or no calibration can be so).

    Matrix K, whose distortion D is ignored, for images as the sensor gives them; ``rectified``: matrix P, where there
    is one, for images from which the distortion has been removed (REP 104). Both are of the whole sensor at full
    resolution; the image is its region of interest (roi, all 0 = all of it), each pixel the mean of binning_x x
    binning_y (0 = 1). Pixel centres sit at whole numbers: x of the image = (x of the sensor - x_offset + 0.5) /
    binning_x - 0.5.
    """
    p, k, roi = info.p, info.k, info.roi
    fx, fy, cx, cy = (p[0], p[5], p[2], p[6]) if rectified and p[0] else (k[0], k[4], k[2], k[5])
    across, down = max(1, int(info.binning_x)), max(1, int(info.binning_y))
    return CameraModel.of(
        int(roi.width or info.width) // across, int(roi.height or info.height) // down, float(fx) / across,
        float(fy) / down, _binned(float(cx) - roi.x_offset, across), _binned(float(cy) - roi.y_offset, down))


def _binned(position: float, pixels: int) -> float:
    return (position + 0.5) / pixels - 0.5
