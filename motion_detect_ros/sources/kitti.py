"""KITTI raw drives: rectified pictures of a camera, the left colour one as a rule, stamps, calibration, inertial data.

Source: Geiger, Lenz, Stiller, Urtasun, "Vision meets Robotics: The KITTI Dataset", IJRR 2013; folder layout and
field meanings from the raw data development kit.
"""

from __future__ import annotations

import calendar
import math
import re
import time
from collections.abc import Iterator
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from motion_detect_ros.core.errors import SourceError
from motion_detect_ros.core.types import NANOSECONDS, CameraModel, DoubleArray
from motion_detect_ros.sources.frames import SourceFrame, describe_folder
from motion_detect_ros.sources.images import ImageSequence, image_files
from motion_detect_ros.sources.inertial import GyroSample
from motion_detect_ros.sources.window import WHOLE, Window

#: Pictures of the camera that a drive stands for, the left one in colour; and those of any of its four.
IMAGE_FOLDER, _CAMERA_FOLDER = 'image_02', re.compile(r'image_0[0-3]')
CALIBRATION_NAME = 'calib_cam_to_cam.txt'
LAYOUT = 'image_02/data/*.png or *.jpg, image_02/timestamps.txt, oxts/, and calib_cam_to_cam.txt beside the drive'

_STAMP_PATTERN = re.compile(r'(\d{4}-\d\d-\d\d \d\d:\d\d:\d\d)(?:\.(\d{1,9}))?$')
_OXTS_COLUMNS = 30


@dataclass(frozen=True)
class Calibration:
    """``camera``: the rectified pinhole; ``projection``: (3, 4) float64, P_rect_0N as published."""

    camera: CameraModel
    projection: DoubleArray

    def fits(self, width: int, height: int) -> bool:
        """Whether pictures of this size are those of the camera, or all of each at another scale."""
        full = self.camera.width, self.camera.height
        return abs(width * full[1] - height * full[0]) <= max(full)  # a pixel more or less, for rounding

    def resized(self, width: int, height: int) -> Calibration:
        """Of the same pictures at another size; pixel centres sit at whole numbers."""
        if (width, height) == (self.camera.width, self.camera.height):
            return self
        projection = self.projection.copy()
        for row, scale in enumerate((width / self.camera.width, height / self.camera.height)):
            projection[row] = scale * (projection[row] + 0.5 * projection[2]) - 0.5 * projection[2]
        return Calibration(self.camera.resized(width, height), projection)


@dataclass(frozen=True)
class OxtsSample:
    """One packet of the GPS/IMU unit; body axes x forward, y left, z up.

    Angles rad (yaw 0 = east, counter-clockwise), acceleration m/s^2, angular velocity rad/s, position degrees and m.
    """

    stamp_ns: int
    latitude_deg: float
    longitude_deg: float
    altitude_m: float
    roll: float
    pitch: float
    yaw: float
    acceleration: tuple[float, float, float]
    angular_velocity: tuple[float, float, float]
    position_accuracy_m: float

    @property
    def quaternion(self) -> tuple[float, float, float, float]:
        """(x, y, z, w) of R = Rz(yaw) Ry(pitch) Rx(roll), body to east-north-up, as the development kit has it."""
        sr, cr = math.sin(self.roll / 2), math.cos(self.roll / 2)
        sp, cp = math.sin(self.pitch / 2), math.cos(self.pitch / 2)
        sy, cy = math.sin(self.yaw / 2), math.cos(self.yaw / 2)
        return (sr * cp * cy - cr * sp * sy, cr * sp * cy + sr * cp * sy,
                cr * cp * sy - sr * sp * cy, cr * cp * cy + sr * sp * sy)


class KittiDrive:
    """A raw drive as a frame source; stamps are those of the camera's pictures, UTC, ns.

    Pictures that are not all of what the camera saw (cropped ones) have no calibration; ``complaints`` say so.
    """

    damaged: str | None = None
    calibration: Calibration | None

    def __init__(self, drive: str | Path, window: Window = WHOLE, images: str = IMAGE_FOLDER) -> None:
        """images: folder of the camera, image_00 to image_03. Raises: SourceError where it is no such folder."""
        self.path = Path(drive)
        if not is_kitti_drive(self.path, images):
            found = describe_folder(self.path) if self.path.is_dir() else 'no such folder'
            raise SourceError(f'{self.path}: found {found}; expected a KITTI raw drive: {LAYOUT}')
        files = image_files(self.path / images / 'data')
        if not files:
            raise SourceError(f'{self.path}: no pictures in {images}/data; expected {LAYOUT}')
        stamps = read_stamps(self.path / images / 'timestamps.txt')
        calibration_path = self.path.parent / CALIBRATION_NAME
        self.calibration = (
            read_calibration(calibration_path, images.removeprefix('image_')) if calibration_path.is_file() else None)
        self.camera = self.calibration.camera if self.calibration else None
        self.name = self.path.resolve().name
        stamps_ns = [_stamp_of(file, stamps) for file in files]
        self.images = ImageSequence(files, stamps_ns, self.name, self.camera, window)
        self.complaints: tuple[str, ...] = ()

    @property
    def frame_count(self) -> int:
        """Number of pictures."""
        return self.images.frame_count

    @property
    def bad_reason(self) -> str:
        """As of the pictures."""
        return self.images.bad_reason

    @property
    def bad_frames(self) -> int:
        """Unreadable pictures met in the last iteration."""
        return self.images.bad_frames

    @property
    def frames_passed(self) -> int:
        """Pictures come by in the last iteration."""
        return self.images.frames_passed

    def __iter__(self) -> Iterator[SourceFrame]:
        """Frames in order."""
        self.complaints = ()
        for frame in self.images:
            height, width = frame.image.shape[:2]
            if self.calibration is None or self.calibration.fits(width, height):
                yield frame
                continue
            if not self.complaints:
                self.complaints = (
                    f'{CALIBRATION_NAME} refused (it is for {self.calibration.camera.width}x'
                    f'{self.calibration.camera.height}, the pictures have {width}x{height}): bearings are NaN',)
            yield replace(frame, camera=None)

    def oxts(self) -> list[OxtsSample]:
        """The inertial data in order, empty where the drive has none. Raises: SourceError for a malformed file."""
        folder = self.path / 'oxts'
        if not (folder / 'timestamps.txt').is_file():
            return []
        stamps = read_stamps(folder / 'timestamps.txt')
        return [read_oxts(file, _stamp_of(file, stamps)) for file in sorted((folder / 'data').glob('[!.]*.txt'))]

    def gyro(self) -> Iterator[GyroSample]:
        """Angular rates of the GPS/IMU unit about its body axes (x forward, y left, z up). Raises: as ``oxts``."""
        return (GyroSample(sample.stamp_ns, sample.angular_velocity) for sample in self.oxts())


def is_kitti_drive(folder: Path, images: str = IMAGE_FOLDER) -> bool:
    """True where the folder of a camera's pictures, ``image_02/data``, is inside."""
    return (folder / images / 'data').is_dir()


def camera_of_pictures(folder: Path) -> tuple[Path, str] | None:
    """Drive and camera, ``image_0N``, of a folder ``image_0N/data`` with the stamps beside it; None of another."""
    is_camera = folder.name == 'data' and _CAMERA_FOLDER.fullmatch(folder.parent.name)
    if not is_camera or not (folder.parent / 'timestamps.txt').is_file():
        return None
    return folder.parent.parent, folder.parent.name


def parse_stamp(text: str) -> int:
    """``2011-09-26 13:02:44.323092481`` (UTC) as exact ns since 1970. Raises: SourceError for another form."""
    match = _STAMP_PATTERN.match(text.strip())
    if match is None:
        raise SourceError(f'time stamp: expected YYYY-MM-DD HH:MM:SS.nnnnnnnnn, got {text.strip()!r}')
    try:
        seconds = calendar.timegm(time.strptime(match[1], '%Y-%m-%d %H:%M:%S'))
    except ValueError:
        raise SourceError(f'time stamp: no such date or time: {text.strip()!r}') from None
    return seconds * NANOSECONDS + int((match[2] or '0').ljust(9, '0'))


def read_stamps(path: Path) -> list[int]:
    """The stamps of a timestamps.txt, ns, one a line. Raises: SourceError."""
    try:
        return [parse_stamp(line) for line in path.read_text(encoding='ascii').splitlines() if line.strip()]
    except (OSError, UnicodeDecodeError) as error:
        raise SourceError(f'{path}: expected a list of time stamps: {error}') from None
    except SourceError as error:
        raise SourceError(f'{path}: {error}') from None


def read_calibration(path: Path, camera_number: str) -> Calibration:
    """P_rect and S_rect of a camera, 00 to 03, of a calib_cam_to_cam.txt.

    Raises: SourceError where they are missing or no camera's.
    """
    size, matrix = f'S_rect_{camera_number}', f'P_rect_{camera_number}'
    try:
        text = path.read_text(encoding='ascii', errors='replace')
        lines = dict(line.split(':', 1) for line in text.splitlines() if ':' in line)
        width, height = (int(float(value)) for value in lines[size].split())
        projection = np.array(lines[matrix].split(), np.float64).reshape(3, 4)
    except (OSError, KeyError, ValueError, OverflowError) as error:
        raise SourceError(f'{path}: expected {size} (2 numbers) and {matrix} (12 numbers): {error}') from None
    if min(width, height) < 1:
        raise SourceError(f'{path}: {size}: expected a size in pixels, got {width}x{height}')
    fx, fy, cx, cy = (float(projection[place]) for place in ((0, 0), (1, 1), (0, 2), (1, 2)))
    camera = CameraModel.of(width, height, fx, fy, cx, cy)
    if camera is None:
        raise SourceError(f'{path}: {matrix}: expected focal lengths of 1 px or more, got {fx:g} and {fy:g}, '
                          f'and a finite centre, got {cx:g}, {cy:g}')
    return Calibration(camera, projection)


def read_oxts(path: Path, stamp_ns: int) -> OxtsSample:
    """One packet of oxts/data. Raises: SourceError for another number of columns."""
    try:
        values = [float(value) for value in path.read_text(encoding='ascii').split()]
    except ValueError:
        values = []
    if len(values) != _OXTS_COLUMNS:
        raise SourceError(f'{path}: expected {_OXTS_COLUMNS} numbers, got {len(values)}')
    latitude, longitude, altitude, roll, pitch, yaw = values[:6]
    return OxtsSample(
        stamp_ns, latitude, longitude, altitude, roll, pitch, yaw, (values[11], values[12], values[13]),
        (values[17], values[18], values[19]), values[23])


def _stamp_of(file: Path, stamps: list[int]) -> int:
    """The stamp that belongs to a file by its number: line 1 is ``0000000000``."""
    if not file.stem.isdecimal():
        raise SourceError(f'{file}: expected a file named by its number, such as 0000000000{file.suffix}')
    if int(file.stem) >= len(stamps):
        raise SourceError(f'{file}: timestamps.txt has {len(stamps)} lines, none for this file')
    return stamps[int(file.stem)]
