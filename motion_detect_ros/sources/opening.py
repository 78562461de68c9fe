"""Opens whatever holds pictures: bag, video, image folder, VisDrone sequence, KITTI drive."""

from __future__ import annotations

import math
import os
from collections.abc import Iterable
from pathlib import Path

from motion_detect_ros.core.errors import SourceError
from motion_detect_ros.sources.bag_reader import BAG_SUFFIXES
from motion_detect_ros.sources.bags import BagFrames, is_bag
from motion_detect_ros.sources.frames import DEFAULT_FPS, FrameSource, describe_folder, describe_special
from motion_detect_ros.sources.images import image_files, image_folder, leads_nowhere
from motion_detect_ros.sources.kitti import KittiDrive, camera_of_pictures, is_kitti_drive
from motion_detect_ros.sources.video import VIDEO_SUFFIXES, VideoFile
from motion_detect_ros.sources.window import WHOLE, Window

#: Folder of the pictures in a sequence of MOT Challenge.
MOT_PICTURES = 'img1'


def open_source(
    path: str | Path, fps: float | None = None, topic: str | None = None, window: Window = WHOLE,
    rectified: bool = False,
) -> FrameSource:
    """Open a bag (MCAP, db3, ROS 1 or folder), video, image folder, VisDrone sequence or KITTI raw drive.

    fps: frame rate, 1/s; overrides the rate of a video or folder without time stamps, ignored where the source
    has stamps of its own (bag, KITTI drive). topic: image topic of a bag, needed where it has several.
    window: the part of it that is given; frames keep the index that they have in the whole. rectified: of a bag, as for
    ``camera_of``.
    Raises: SourceError with one line that says what was found and what is expected.
    """
    if not str(path):
        raise SourceError('source: expected a path, got nothing')
    path = Path(path)
    check_name(path)
    check_rate('frame rate', fps)
    try:
        if path.is_dir():
            return _open_folder(path, fps, topic, window, rectified)
        if path.is_file():
            return BagFrames(path, topic, window, rectified) if is_bag(path) else VideoFile(path, fps, window)
        if kind := describe_special(path):
            raise SourceError(f'{path}: expected a file or folder, got {kind}')
    except OSError as error:
        raise SourceError(f'{path}: cannot be read: {error.strerror or error}') from None
    raise SourceError(f'{path}: no such file or folder')


def check_name(path: Path) -> None:
    """Raises: SourceError for a name that is no UTF-8: neither OpenCV nor the files of results can hold it."""
    try:
        str(path).encode()
    except UnicodeEncodeError:
        shown = os.fsencode(path).decode('utf-8', 'backslashreplace')
        raise SourceError(f'{shown}: expected a name in UTF-8; rename it') from None


def check_rate(name: str, fps: float | None) -> None:
    """Raises: SourceError for a rate (1/s) that is none; None is not given."""
    if fps is not None and not 0 < fps < math.inf:
        raise SourceError(f'{name}: expected a number over 0, got {fps:g}')


def check_rate_is_used(name: str, fps: float | None, paths: Iterable[str]) -> None:
    """Raises: SourceError for a rate (1/s) where each of the inputs has stamps of its own; None is not given."""
    if fps is not None and all(_has_stamps(Path(path)) for path in paths):
        raise SourceError(f'{name}: expected an input without stamps of its own (video, pictures), got bags or KITTI '
                          'drives only')


def _has_stamps(path: Path) -> bool:
    """Whether a rate says nothing to it; false for what cannot be read, which is said when it is opened."""
    try:
        return is_bag(path) or is_kitti_drive(path) or camera_of_pictures(path) is not None
    except OSError:
        return False


def looks_like_source(path: Path) -> bool:
    """Whether ``open_source`` would try: by the name of a file or its first bytes, by what is in a folder; of
    a link to what is not there by its name.
    """
    if path.is_dir():
        return is_bag(path) or is_kitti_drive(path) or bool(image_files(path))
    if leads_nowhere(path):
        return path.suffix.lower() in {*BAG_SUFFIXES, *VIDEO_SUFFIXES}
    return path.is_file() and (path.suffix.lower() in VIDEO_SUFFIXES or is_bag(path))


def source_name(path: str | Path) -> str:
    """The name of an input: that of a folder as it is, dots and all, that of a bag's or video's file without suffix.

    The pictures of a MOT Challenge sequence are in a folder ``img1`` of it.
    """
    path = Path(path)
    if path.name == MOT_PICTURES and path.parent.name:
        return path.parent.name
    is_file = path.suffix.lower() in {*BAG_SUFFIXES, *VIDEO_SUFFIXES} and not path.is_dir()
    return path.stem if is_file else path.name


def _open_folder(path: Path, fps: float | None, topic: str | None, window: Window, rectified: bool) -> FrameSource:
    if is_bag(path):
        return BagFrames(path, topic, window, rectified)
    if is_kitti_drive(path):
        return KittiDrive(path, window)
    if camera := camera_of_pictures(path):
        drive, images = camera
        return KittiDrive(drive, window, images)
    if image_files(path):
        return image_folder(path, fps or DEFAULT_FPS, window)  # a VisDrone sequence is one of these
    raise SourceError(
        f'{path}: found {describe_folder(path)}; expected pictures (a VisDrone sequence or image folder), '
        'image_02/data (a KITTI raw drive) or a bag (metadata.yaml, *.mcap, *.db3, *.bag)')
