"""``camera_info`` of the camera node; ``camera_info_url`` as ROS's camera drivers take it: file:// and package://."""

from __future__ import annotations

from pathlib import Path

from ament_index_python.packages import PackageNotFoundError, get_package_share_directory
from sensor_msgs.msg import CameraInfo
from std_msgs.msg import Header

from motion_detect_ros.bridge.images import camera_to_msg
from motion_detect_ros.core.errors import SourceError
from motion_detect_ros.core.types import CameraModel
from motion_detect_ros.sources.calibration_file import CalibrationFile, read_calibration

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


def info_of_image(
    given: CalibrationFile | CameraModel | None, width: int, height: int, header: Header,
) -> tuple[CameraInfo, str]:
    """The calibration if it fits an image of this size, pixels, else that of an uncalibrated camera, and why."""
    size = (given.width or width, given.height or height) if given else (width, height)
    if size != (width, height):
        complaint = 'calibration not used: expected one of {}x{} px, got {}x{}'.format(width, height, *size)
        return camera_to_msg(None, width, height, header), complaint
    if isinstance(given, CalibrationFile):
        return calibration_to_msg(given, header), ''
    return camera_to_msg(given, width, height, header), ''
