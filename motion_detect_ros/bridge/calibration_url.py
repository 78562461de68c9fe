"""``camera_info`` of the camera node; ``camera_info_url`` as ROS's camera drivers take it: file:// and package://."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from ament_index_python.packages import PackageNotFoundError, get_package_share_directory
from sensor_msgs.msg import CameraInfo, RegionOfInterest
from std_msgs.msg import Header

from motion_detect_ros.bridge.images import camera_to_msg
from motion_detect_ros.core.errors import SourceError
from motion_detect_ros.core.types import ByteArray, CameraModel
from motion_detect_ros.sources.calibration_file import CalibrationFile, read_calibration
from motion_detect_ros.sources.camera_info import camera_of

FILE, PACKAGE = 'file://', 'package://'


def calibration_at(url: str) -> CalibrationFile:
    """The calibration of a ``file:///full/path.yaml`` or ``package://name/path.yaml``. Raises: SourceError."""
    if url.startswith(FILE):
        return read_calibration(Path(url.removeprefix(FILE)))
    if not url.startswith(PACKAGE):
        raise SourceError(f'camera_info_url: expected {FILE} or {PACKAGE}, got {url!r}')
    package, _, rest = url.removeprefix(PACKAGE).partition('/')
    try:
        share = Path(get_package_share_directory(package))
    except (PackageNotFoundError, ValueError, OSError):  # OSError: there is no AMENT_PREFIX_PATH
        raise SourceError(f'camera_info_url: expected an installed package, got {package!r}') from None
    return read_calibration(share / rest)


def calibration_to_msg(calibration: CalibrationFile, header: Header) -> CameraInfo:
    """The message that goes with an image."""
    return CameraInfo(
        header=header, width=calibration.width, height=calibration.height,
        distortion_model=calibration.distortion_model, d=list(calibration.d), k=list(calibration.k),
        r=list(calibration.r), p=list(calibration.p))


def recorded_to_msg(info: Any, header: Header) -> CameraInfo:
    """A CameraInfo that rosbags has read, with another header."""
    roi = {name: getattr(info.roi, name) for name in RegionOfInterest.get_fields_and_field_types()}
    return CameraInfo(
        header=header, width=info.width, height=info.height, distortion_model=info.distortion_model, d=list(info.d),
        k=list(info.k), r=list(info.r), p=list(info.p), binning_x=info.binning_x, binning_y=info.binning_y,
        roi=RegionOfInterest(**roi))


def info_of_image(
    given: CalibrationFile | CameraModel | Any, image: ByteArray, header: Header,
) -> tuple[CameraInfo, str]:
    """The calibration if it fits an image, (H, W) or (H, W, 3), else that of an uncalibrated camera, and why.

    given: None where there is none; sensor_msgs/CameraInfo as rosbags reads it is of the sensor as a whole.
    """
    height, width = image.shape[:2]
    recorded = None if isinstance(given, CalibrationFile | CameraModel) else given
    if recorded is not None:
        given = camera_of(recorded) or camera_of(recorded, rectified=True)
    size = (given.width or width, given.height or height) if given else (width, height)
    if size != (width, height):
        complaint = 'calibration not used: expected one of {}x{} px, got {}x{}'.format(width, height, *size)
        return camera_to_msg(None, width, height, header), complaint
    if isinstance(given, CalibrationFile):
        return calibration_to_msg(given, header), ''
    if recorded is not None and given is not None:
        return recorded_to_msg(recorded, header), ''
    return camera_to_msg(given, width, height, header), ''
