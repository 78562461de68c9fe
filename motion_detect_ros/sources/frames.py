"""Pictures from outside, one interface for all of them: iterate a source, get frames with their stamps."""

from __future__ import annotations

import stat
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Protocol

from motion_detect_ros.core.types import NANOSECONDS, ByteArray, CameraModel

#: Stamp of the first picture of sources that tell no time of day, ns: 0 would be "the latest" to tf2.
FIRST_STAMP_NS = NANOSECONDS
#: frame_id of pictures of unknown cameras, live and in bags.
CAMERA_FRAME = 'camera_optical_frame'
#: Rate of image sequences that come without time stamps, frames/s, where the user gives none.
DEFAULT_FPS = 25.0

#: What may be at a path besides files and folders.
_SPECIAL = ((stat.S_ISCHR, 'a device; a camera is for the camera node'), (stat.S_ISBLK, 'a disk'),
            (stat.S_ISFIFO, 'a pipe'), (stat.S_ISSOCK, 'a socket'))

#: At most this many names are listed when a folder does not look as expected.
_LISTED_NAMES = 6


@dataclass(frozen=True)
class SourceFrame:
    """One picture of a source.

    ``index``: position in the source, from 0; an unreadable frame uses its index up, so that truth stays aligned.
    ``image``: (H, W) grey or (H, W, 3) BGR, uint8. ``stamp_ns``: time of the picture by the source's clock, ns.
    ``camera``: its calibration, None = unknown. ``frame_id``: of its optical axis, as the source names it.
    """

    index: int
    image: ByteArray
    stamp_ns: int
    camera: CameraModel | None = None
    frame_id: str = CAMERA_FRAME


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
        """The calibration of the first picture, None where the source has none."""

    @property
    def bad_frames(self) -> int:
        """Unreadable frames skipped since iteration last began."""

    @property
    def bad_reason(self) -> str:
        """Number of the first of them, and what is wrong with it; empty for none."""

    @property
    def frames_passed(self) -> int:
        """Frames come by since iteration last began: unreadable and left-out ones too, none after the window's end."""

    @property
    def damaged(self) -> str | None:
        """What is wrong with the source as a whole, None for nothing known so far."""

    @property
    def complaints(self) -> tuple[str, ...]:
        """What else is worth a word of what has come by since iteration last began."""


def first_reason(earlier: str, index: int, error: Exception | str) -> str:
    """``bad_reason`` after another bad frame, number ``index``."""
    return earlier or f'frame {index}: {error}'


def describe_special(path: Path) -> str | None:
    """What kind of thing is at a path, for messages; None for nothing, a file or a folder. Raises: OSError."""
    if not path.exists():
        return None
    mode = path.stat().st_mode
    return next((kind for is_of_kind, kind in _SPECIAL if is_of_kind(mode)), None)


def describe_folder(folder: Path) -> str:
    """What is in a folder, in a few words, for messages."""
    names = sorted(entry.name + '/' * entry.is_dir() for entry in folder.iterdir())
    more = ', ...' if len(names) > _LISTED_NAMES else ''
    return ', '.join(names[:_LISTED_NAMES]) + more if names else 'nothing'
