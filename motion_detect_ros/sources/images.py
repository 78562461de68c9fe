"""Folders of pictures: one file a frame, in the natural order of their names."""

from __future__ import annotations

import os
import re
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import numpy.typing as npt

from motion_detect_ros.core.errors import SourceError
from motion_detect_ros.core.types import NANOSECONDS, ByteArray, CameraModel
from motion_detect_ros.sources.encoding import ImageDecoder
from motion_detect_ros.sources.frames import FIRST_STAMP_NS, SourceFrame, describe_folder, first_reason
from motion_detect_ros.sources.window import WHOLE, Choice, Selection, Window

IMAGE_SUFFIXES = frozenset({'.jpg', '.jpeg', '.png', '.bmp', '.tif', '.tiff', '.webp', '.ppm', '.pgm'})

#: Grey stays grey; never turned by an EXIF tag, as flow and calibration belong to the sensor's own axes.
AS_STORED = cv2.IMREAD_ANYCOLOR | cv2.IMREAD_IGNORE_ORIENTATION
_DEEP = AS_STORED | cv2.IMREAD_ANYDEPTH
_JPEG_START, _JPEG_END = b'\xff\xd8', 0xd9
#: A marker of JPEG; coded pixels hold 0xff before 0 and between the eight restart markers only (ITU T.81, B.1.1).
_JPEG_MARKER = re.compile(rb'\xff[^\x00\xd0-\xd7\xff]')
#: A PNG is this, then chunks: 4 bytes of length, 4 of kind, the content, 4 of checksum.
_PNG_START, _PNG_END, _PNG_CHUNK_BYTES = b'\x89PNG\r\n\x1a\n', b'IEND', 12

#: The limit of OpenCV, which the package sets where the user does not; what its error names; its limit of a side, px.
_MAX_PIXELS, _SIZE_LIMIT, _LONGEST_SIDE_PX = 'OPENCV_IO_MAX_IMAGE_PIXELS', 'CV_IO_MAX_IMAGE', 1 << 20


class PictureSizeError(SourceError):
    """A picture with more pixels than may be decoded."""


def decode_image(data: bytes, what: str, decoder: ImageDecoder | None = None) -> ByteArray:
    """Decode an image file held in memory to (H, W) grey or (H, W, 3) BGR, uint8.

    what: name for the message; decoder: of the stream, learns the depth of 16-bit images from those before, None = this
    is the only one. Raises: SourceError where the bytes are no complete picture, PictureSizeError where their header
    promises a larger one than OpenCV is allowed to decode.
    """
    if data.startswith(_JPEG_START) and not _has_jpeg_end(data):
        # OpenCV would fill the missing rows with grey and call it a picture.
        raise SourceError(f'{what}: JPEG is cut off after {len(data)} bytes')
    if data.startswith(_PNG_START) and not _has_all_chunks(data):
        # OpenCV would take the memory that a damaged length asks for, up to 4 GB.
        raise SourceError(f'{what}: PNG is cut off after {len(data)} bytes')
    image = _decoded(data, _DEEP, what)
    if image is not None and image.dtype == np.uint16:
        return (decoder or ImageDecoder()).reduced(image)
    if image is not None and image.dtype != np.uint8:  # of floating point
        image = _decoded(data, AS_STORED, what)
    if image is None:
        raise SourceError(f'{what}: {len(data)} bytes that are no picture')
    return image.astype(np.uint8, copy=False)


def _decoded(data: bytes, flags: int, what: str) -> npt.NDArray[Any] | None:
    try:
        return cv2.imdecode(np.frombuffer(data, np.uint8), flags) if data else None
    except cv2.error as error:
        if _SIZE_LIMIT not in str(error):
            return None
        raise PictureSizeError(f'{what}: expected a picture of at most {os.environ.get(_MAX_PIXELS, "2^30")} pixels '
                               f'({_MAX_PIXELS}) and {_LONGEST_SIDE_PX} a side, got a larger one') from None


def _has_jpeg_end(jpeg: bytes) -> bool:
    """Whether the end marker comes; that of a thumbnail does not count, and what follows does not matter."""
    place = len(_JPEG_START)
    while found := _JPEG_MARKER.search(jpeg, place):
        place = found.end()
        if jpeg[place - 1] == _JPEG_END:
            return True
        place += int.from_bytes(jpeg[place:place + 2], 'big')  # the length of its segment, thumbnails are inside one
    return False


def _has_all_chunks(png: bytes) -> bool:
    place = len(_PNG_START)
    while place + _PNG_CHUNK_BYTES <= len(png):
        kind = png[place + 4:place + 8]
        place += _PNG_CHUNK_BYTES + int.from_bytes(png[place:place + 4], 'big')
        if kind == _PNG_END:
            return place <= len(png)
    return False


def image_files(folder: Path) -> list[Path]:
    """The picture files of a folder (not of its sub-folders), ``2.png`` before ``10.png``; no hidden ones. A link to
    what is not there (git-annex, a disk that is not mounted) is one that cannot be read.
    """
    files = [file for file in folder.iterdir()
             if file.suffix.lower() in IMAGE_SUFFIXES and not file.name.startswith('.')
             and (file.is_file() or leads_nowhere(file))]
    return sorted(files, key=lambda file: natural_key(file.name))


def leads_nowhere(path: Path) -> bool:
    """Whether it is a link to what is not there. Raises: OSError."""
    return path.is_symlink() and not path.exists()


def natural_key(name: str) -> tuple[tuple[int, str], ...]:
    """Sort key that compares runs of digits as numbers."""
    parts = re.split(r'(\d+)', name)
    return tuple((int(part), '') if part.isdecimal() else (-1, part) for part in parts)


def even_stamps(count: int, fps: float) -> list[int]:
    """``count`` stamps at ``fps`` frames/s from FIRST_STAMP_NS, ns; rounded one by one so that no error adds up."""
    return [FIRST_STAMP_NS + round(index * NANOSECONDS / fps) for index in range(count)]


class ImageSequence:
    """Picture files with a stamp each, as a frame source."""

    damaged: str | None = None
    complaints: tuple[str, ...] = ()

    def __init__(
        self, files: Sequence[Path], stamps_ns: Sequence[int], name: str, camera: CameraModel | None = None,
        window: Window = WHOLE,
    ) -> None:
        """files, stamps_ns: one stamp (ns) a file, in order of time. Raises: SourceError for unequal lengths."""
        if len(files) != len(stamps_ns):
            raise SourceError(f'{name}: {len(files)} pictures but {len(stamps_ns)} time stamps')
        self.files = tuple(files)
        self.stamps_ns = tuple(stamps_ns)
        self.name = name
        self.camera = camera
        self.bad_frames, self.bad_reason, self.frames_passed = 0, '', 0
        self._window = window

    @property
    def frame_count(self) -> int:
        """Number of files."""
        return len(self.files)

    def __iter__(self) -> Iterator[SourceFrame]:
        """Frames in order; an unreadable file costs itself only and is counted in ``bad_frames``.

        Raises: SourceError where the folder of a file has gone.
        """
        self.bad_frames, self.bad_reason, self.frames_passed = 0, '', 0
        decoder, selection = ImageDecoder(), Selection(self._window)
        for index, (file, stamp_ns) in enumerate(zip(self.files, self.stamps_ns, strict=True)):
            choice = selection.judge(index, stamp_ns)
            if choice is Choice.END:
                return
            self.frames_passed = index + 1
            if choice is Choice.SKIP:
                continue
            try:
                image = decode_image(file.read_bytes(), str(file), decoder)
            except (SourceError, OSError) as error:
                if not file.parent.is_dir():
                    raise SourceError(f'{file.parent}: the folder has gone while it was read') from None
                self.bad_frames += 1
                self.bad_reason = first_reason(self.bad_reason, index, error)
                continue
            yield SourceFrame(index, image, stamp_ns, self.camera)


def image_folder(folder: Path, fps: float, window: Window = WHOLE) -> ImageSequence:
    """The pictures of a folder at ``fps`` frames/s, the first at stamp 0. Raises: SourceError for no pictures."""
    if not folder.is_dir():
        raise SourceError(f'{folder}: no such folder')
    files = image_files(folder)
    if not files:
        raise SourceError(f'{folder}: found {describe_folder(folder)}; expected picture files (.jpg, .png, ...)')
    return ImageSequence(files, even_stamps(len(files), fps), folder.resolve().name, window=window)
