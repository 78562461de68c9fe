"""Opens whatever holds pictures: bag, video, image folder, VisDrone sequence, KITTI drive."""

from __future__ import annotations

import math
from pathlib import Path

from motion_detect_ros.core.errors import SourceError
from motion_detect_ros.sources.bags import BagFrames, is_bag
from motion_detect_ros.sources.frames import DEFAULT_FPS, FrameSource, describe_folder
from motion_detect_ros.sources.images import image_files, image_folder
from motion_detect_ros.sources.kitti import KittiDrive, is_kitti_drive
from motion_detect_ros.sources.video import VideoFile


def open_source(path: str | Path, fps: float | None = None, topic: str | None = None) -> FrameSource:
    """Open a bag (MCAP, db3 or folder), video, image folder, VisDrone sequence or KITTI raw drive.

    fps: frame rate, 1/s; overrides the rate of a video or folder without time stamps, ignored where the source
    has stamps of its own (bag, KITTI drive). topic: image topic of a bag, needed where it has several.
    Raises: SourceError with one line that says what was found and what is expected.
    """
    if not str(path):
        raise SourceError('source: expected a path, got nothing')
    path = Path(path)
    check_rate('frame rate', fps)
    if path.is_dir():
        return _open_folder(path, fps, topic)
    if path.is_file():
        return _open_file(path, fps, topic)
    raise SourceError(f'{path}: no such file or folder')


def check_rate(name: str, fps: float | None) -> None:
    """Raises: SourceError for a rate (1/s) that is none; None is not given."""
    if fps is not None and not 0 < fps < math.inf:
        raise SourceError(f'{name}: expected a number over 0, got {fps:g}')


def _open_file(path: Path, fps: float | None, topic: str | None) -> FrameSource:
    if is_bag(path):
        return BagFrames(path, topic)
    return VideoFile(path, fps)


def _open_folder(path: Path, fps: float | None, topic: str | None) -> FrameSource:
    if is_bag(path):
        return BagFrames(path, topic)
    if is_kitti_drive(path):
        return KittiDrive(path)
    if path.name == 'data' and (path.parent / 'timestamps.txt').is_file() and is_kitti_drive(path.parent.parent):
        return KittiDrive(path.parent.parent)  # the pictures' own folder: its stamps are beside it
    if image_files(path):
        return image_folder(path, fps or DEFAULT_FPS)  # a VisDrone sequence is one of these
    raise SourceError(
        f'{path}: found {describe_folder(path)}; expected pictures (a VisDrone sequence or image folder), '
        'image_02/data (a KITTI raw drive) or a bag (metadata.yaml, *.mcap, *.db3)')
