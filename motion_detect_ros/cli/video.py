"""Pictures to a video file."""

from __future__ import annotations

from pathlib import Path
from types import TracebackType
from typing import Self

import cv2

from motion_detect_ros.core.errors import BackendError, FrameError
from motion_detect_ros.core.types import ByteArray

#: MPEG-4 part 2: the codec that every OpenCV build can write into an MP4; H.264 is missing from the free ones.
CODEC = 'mp4v'


class VideoWriter:
    """An MP4 under construction; use as a context manager.

    It is written as ``<name>.part.mp4`` and gets its name when complete; left by an exception, the part stays.
    """

    def __init__(self, path: Path, fps: float) -> None:
        """fps: frames a second at which it will play."""
        self.path = path
        self.part_path = path.with_name(f'{path.stem}.part{path.suffix}')
        self.frame_count = 0
        self._fps = fps
        self._shape: tuple[int, ...] = ()
        self._writer: cv2.VideoWriter | None = None

    def write(self, image: ByteArray) -> None:
        """Add one picture, (H, W, 3) uint8 BGR, of the same shape as all before.

        Raises: FrameError for another shape, BackendError where this OpenCV cannot write the file.
        """
        if self._writer is None:
            self._open(image)
        if image.shape != self._shape or self._writer is None:
            raise FrameError(f'{self.path}: expected a picture of shape {self._shape}, got {image.shape}')
        self._writer.write(image)
        self.frame_count += 1

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None,
    ) -> None:
        if self._writer is None:
            return
        self._writer.release()
        if kind is None:
            self.part_path.replace(self.path)

    def _open(self, image: ByteArray) -> None:
        if image.ndim != 3:
            raise FrameError(f'{self.path}: expected a picture of shape (H, W, 3), got {image.shape}')
        height, width = image.shape[:2]
        codec = cv2.VideoWriter.fourcc(*CODEC)
        writer = cv2.VideoWriter(str(self.part_path), codec, self._fps, (width, height))
        if not writer.isOpened():
            raise BackendError(f'{self.path}: this OpenCV cannot write {CODEC} video, or not to this folder')
        self._writer, self._shape = writer, image.shape
