"""Pictures from outside, one interface for all of them: iterate a source, get frames with their stamps."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Protocol

from motion_detect_ros.core.errors import SourceError
from motion_detect_ros.core.types import ByteArray, CameraModel

#: Rate of image sequences that come without time stamps, frames/s, where the user gives none.
DEFAULT_FPS = 25.0

#: At most this many names are listed when a folder does not look as expected.
_LISTED_NAMES = 6


@dataclass(frozen=True)
class SourceFrame:
    """One picture of a source.

    ``index``: position in the source, from 0; an unreadable frame uses its index up, so that truth stays aligned.
    ``image``: (H, W) grey or (H, W, 3) BGR, uint8. ``stamp_ns``: time of the picture by the source's clock, ns.
    """

    index: int
    image: ByteArray
    stamp_ns: int


class FrameSource(Protocol):
    """Anything that gives frames; iterating again starts from the first frame."""

    def __iter__(self) -> Iterator[SourceFrame]:
        """The frames, in order of time."""

    @property
    def name(self) -> str:
        """Short name, fit for a folder."""

    @property
    def frame_count(self) -> int | None:
        """How many frames there are, None where only reading them tells."""

    @property
    def camera(self) -> CameraModel | None:
        """The calibration, None where the source has none."""

    @property
    def bad_frames(self) -> int:
        """Unreadable frames skipped since iteration last began."""

    @property
    def damaged(self) -> str | None:
        """What is wrong with the source as a whole, None for nothing known so far."""


def open_source(path: str | Path, fps: float | None = None, topic: str | None = None) -> FrameSource:
    """Open a bag (MCAP, db3 or folder), video, image folder, VisDrone sequence or KITTI raw drive.

    fps: frame rate, 1/s; overrides the rate of a video or folder without time stamps, ignored where the source
    has stamps of its own (bag, KITTI drive). topic: image topic of a bag, needed where it has several.
    Raises: SourceError with one line that says what was found and what is expected.
    """
    path = Path(path)
    if fps is not None and not fps > 0:
        raise SourceError(f'frame rate: expected a number over 0, got {fps:g}')
    if path.is_dir():
        return _open_folder(path, fps, topic)
    if path.is_file():
        return _open_file(path, fps, topic)
    raise SourceError(f'{path}: no such file or folder')


def describe_folder(folder: Path) -> str:
    """What is in a folder, in a few words, for messages."""
    names = sorted(entry.name + '/' * entry.is_dir() for entry in folder.iterdir())
    more = ', ...' if len(names) > _LISTED_NAMES else ''
    return ', '.join(names[:_LISTED_NAMES]) + more if names else 'nothing'


def _open_file(path: Path, fps: float | None, topic: str | None) -> FrameSource:
    from motion_detect_ros.sources.bags import BagFrames, is_bag
    from motion_detect_ros.sources.video import VideoFile
    if is_bag(path):
        return BagFrames(path, topic)
    return VideoFile(path, fps)


def _open_folder(path: Path, fps: float | None, topic: str | None) -> FrameSource:
    from motion_detect_ros.sources.bags import BagFrames, is_bag
    from motion_detect_ros.sources.images import image_files, image_folder
    from motion_detect_ros.sources.kitti import KittiDrive, is_kitti_drive
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
