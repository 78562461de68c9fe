"""Pictures to a small film that browsers play, in memory.

With PyAV, as the writer of OpenCV cannot be told a bit rate: it takes some 60 kB of VP9 for a picture of 960 x 540, ten
times as much.
"""

from __future__ import annotations

import io
from fractions import Fraction
from types import TracebackType
from typing import TYPE_CHECKING, Self, cast

import cv2

from motion_detect_ros.core.errors import BackendError
from motion_detect_ros.core.types import ByteArray

if TYPE_CHECKING:
    from av.video.frame import VideoFrame
    from av.video.stream import VideoStream

#: VP9 in WebM: free, and every browser plays it.
CODEC, FORMAT = 'libvpx-vp9', 'webm'
#: Fast settings: real-time effort, and a quality that keeps objects of 10 pixels.
OPTIONS = {'deadline': 'realtime', 'cpu-used': '7', 'row-mt': '1', 'crf': '34'}
#: The same bytes for the same pictures: no random identity.
CONTAINER_OPTIONS = {'fflags': '+bitexact'}
MAX_WIDTH_PX, MAX_HEIGHT_PX = 960, 720
#: What is aimed at for a whole film (it may become a third more), and for one picture of 960 x 540, bytes.
FILM_BYTES, PICTURE_BYTES = 5_500_000, 6_000
_PICTURE_PIXELS = 960 * 540
#: Key frames let a player jump.
KEY_FRAME_EVERY = 50


def film_size(width: int, height: int) -> tuple[int, int]:
    """Size of the film for pictures of width x height pixels: not larger than they are, both even."""
    scale = min(1.0, MAX_WIDTH_PX / max(width, 1), MAX_HEIGHT_PX / max(height, 1))
    return max(2, 2 * round(width * scale / 2)), max(2, 2 * round(height * scale / 2))


class Film:
    """A film under construction; use as a context manager, then take its ``content``."""

    def __init__(self, size: tuple[int, int], fps: float, pictures: int) -> None:
        """size: width and height, px, both even; pictures: how many there will be, which says what each may take.

        Raises: BackendError where this FFmpeg has no encoder for VP9.
        """
        import av
        self.size = size
        self.frames = 0
        self._file = io.BytesIO()
        self._frame_of = av.VideoFrame.from_ndarray
        self._container = av.open(self._file, 'w', format=FORMAT, options=CONTAINER_OPTIONS)
        share = size[0] * size[1] / _PICTURE_PIXELS
        bytes_each = min(PICTURE_BYTES * share, FILM_BYTES / max(pictures, 1))
        try:
            self._stream = cast('VideoStream', self._container.add_stream(
                CODEC, rate=Fraction(round(1000 * fps), 1000), options=OPTIONS))
        except av.FFmpegError as error:
            raise BackendError(f'film: this build of FFmpeg has no encoder {CODEC}: {error}') from None
        self._stream.width, self._stream.height = size
        self._stream.pix_fmt = 'yuv420p'
        self._stream.bit_rate = round(8 * fps * bytes_each)
        self._stream.gop_size = KEY_FRAME_EVERY

    def add(self, image: ByteArray) -> None:
        """Add one picture, (H, W) grey or (H, W, 3) BGR, uint8, of any size."""
        bgr = cv2.cvtColor(image, cv2.COLOR_GRAY2BGR) if image.ndim == 2 else image
        small = bgr if bgr.shape[1::-1] == self.size else cv2.resize(bgr, self.size, interpolation=cv2.INTER_AREA)
        self._write(self._frame_of(small, format='bgr24'))
        self.frames += 1

    @property
    def content(self) -> bytes:
        """The finished film."""
        return self._file.getvalue()

    def _write(self, frame: VideoFrame | None) -> None:
        for packet in self._stream.encode(frame):
            self._container.mux(packet)

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None,
    ) -> None:
        if kind is None and self.frames:
            self._write(None)
        self._container.close()
