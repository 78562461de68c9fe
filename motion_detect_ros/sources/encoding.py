"""The one codec between the bytes of a sensor_msgs/Image and numpy images; knows no ROS.

``step`` (bytes a row, padding included) and endianness are honoured. What is already contiguous bgr8 or mono8 is
viewed, not copied.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import cv2
import numpy as np
import numpy.typing as npt

from motion_detect_ros.core.errors import MessageError

ImageArray = npt.NDArray[Any]

#: Two pixels share their colour.
_PAIRED = frozenset({cv2.COLOR_YUV2BGR_UYVY, cv2.COLOR_YUV2BGR_YUY2})


@dataclass(frozen=True)
class Encoding:
    """Layout of one pixel, and the OpenCV conversion to grey or BGR (None: it is already)."""

    dtype: str
    channels: int
    convert: int | None = None


#: Names as in sensor_msgs/image_encodings.hpp. Bayer names there tell the first two pixels of the first row, OpenCV's
#: the second and third of the second row, hence the swap.
ENCODINGS: dict[str, Encoding] = {
    'mono8': Encoding('u1', 1), '8UC1': Encoding('u1', 1),
    'bgr8': Encoding('u1', 3), '8UC3': Encoding('u1', 3),
    'rgb8': Encoding('u1', 3, cv2.COLOR_RGB2BGR),
    'bgra8': Encoding('u1', 4, cv2.COLOR_BGRA2BGR), '8UC4': Encoding('u1', 4, cv2.COLOR_BGRA2BGR),
    'rgba8': Encoding('u1', 4, cv2.COLOR_RGBA2BGR),
    'mono16': Encoding('u2', 1), '16UC1': Encoding('u2', 1),
    'bgr16': Encoding('u2', 3), 'rgb16': Encoding('u2', 3, cv2.COLOR_RGB2BGR),
    'uyvy': Encoding('u1', 2, cv2.COLOR_YUV2BGR_UYVY), 'yuv422': Encoding('u1', 2, cv2.COLOR_YUV2BGR_UYVY),
    'yuyv': Encoding('u1', 2, cv2.COLOR_YUV2BGR_YUY2), 'yuv422_yuy2': Encoding('u1', 2, cv2.COLOR_YUV2BGR_YUY2),
    'bayer_rggb8': Encoding('u1', 1, cv2.COLOR_BayerBG2BGR), 'bayer_bggr8': Encoding('u1', 1, cv2.COLOR_BayerRG2BGR),
    'bayer_gbrg8': Encoding('u1', 1, cv2.COLOR_BayerGR2BGR), 'bayer_grbg8': Encoding('u1', 1, cv2.COLOR_BayerGB2BGR),
}
#: The encoding of flow: two float32 channels.
FLOW_ENCODING = '32FC2'
#: Bits that the sensors behind 16-bit encodings give, lower-aligned.
SENSOR_BITS = (8, 10, 12, 14, 16)


def decode(
    height: int, width: int, encoding: str, is_bigendian: bool, step: int, data: Any, bits: int = SENSOR_BITS[-1],
) -> npt.NDArray[np.uint8]:
    """Pixels as (H, W) grey or (H, W, 3) BGR, uint8.

    data: any object with the buffer protocol; step: bytes a row; bits: that the samples of 16-bit encodings use, 8 to
    16, of which the upper eight are kept; brighter samples become 255.
    Raises: MessageError for an unknown encoding, an impossible size or too few bytes.
    """
    if encoding not in ENCODINGS:
        raise MessageError(f'image encoding: expected one of {", ".join(ENCODINGS)}, got {encoding!r}')
    layout = ENCODINGS[encoding]
    pixels = pixel_rows(height, width, layout.dtype, layout.channels, is_bigendian, step, data)
    if layout.dtype == 'u2':
        pixels = _upper_eight(pixels, bits)
    if layout.convert is None:
        return pixels
    return _converted(pixels, layout.convert, encoding)


class ImageDecoder:
    """``decode`` for the images of one stream, which learns how many bits samples of 16 bits use.

    That is the least of SENSOR_BITS that holds the largest sample seen so far. It only grows, four times at most, so
    that the brightness of the pictures does not follow what is in them.
    """

    def __init__(self) -> None:
        self._bits = SENSOR_BITS[0]

    def decode(
        self, height: int, width: int, encoding: str, is_bigendian: bool, step: int, data: Any,
    ) -> npt.NDArray[np.uint8]:
        """As the function of this name."""
        layout = ENCODINGS.get(encoding)
        if layout and layout.dtype == 'u2':
            self._learn(pixel_rows(height, width, layout.dtype, layout.channels, is_bigendian, step, data))
        return decode(height, width, encoding, is_bigendian, step, data, self._bits)

    def reduced(self, samples: npt.NDArray[np.uint16]) -> npt.NDArray[np.uint8]:
        """The same of a picture of 16 bits that another codec (PNG, TIFF) has decoded; its shape stays."""
        self._learn(samples)
        return _upper_eight(samples, self._bits)

    def _learn(self, samples: ImageArray) -> None:
        if self._bits < SENSOR_BITS[-1]:
            largest = int(samples.max())
            self._bits = max(self._bits, next(bits for bits in SENSOR_BITS if largest < 1 << bits))


def pixel_rows(
    height: int, width: int, dtype: str, channels: int, is_bigendian: bool, step: int, data: Any,
) -> ImageArray:
    """(H, W) or (H, W, channels) view of the bytes, row padding cut off. Raises: MessageError."""
    item = np.dtype(('>' if is_bigendian else '<') + dtype)
    row_bytes = width * channels * item.itemsize
    flat = np.frombuffer(data, np.uint8)
    if height <= 0 or width <= 0:
        raise MessageError(f'image size: expected at least 1x1, got {width}x{height}')
    if step < row_bytes:
        raise MessageError(f'image step: expected at least {row_bytes} bytes for {width} pixels, got {step}')
    needed = step * (height - 1) + row_bytes
    if flat.size < needed:
        raise MessageError(f'image data: expected {step * height} bytes, got {flat.size}')
    rows = np.lib.stride_tricks.as_strided(flat, (height, row_bytes), (step, 1), writeable=False)
    if step != row_bytes:
        rows = np.ascontiguousarray(rows)
    pixels = rows.view(item) if step != row_bytes else flat[:height * row_bytes].view(item)
    shape = (height, width) if channels == 1 else (height, width, channels)
    return pixels.reshape(shape)


def encoding_of(image: ImageArray) -> str:
    """``mono8`` or ``bgr8`` of a uint8 image. Raises: MessageError for another shape or type."""
    if image.dtype == np.uint8 and image.ndim == 2:
        return 'mono8'
    if image.dtype == np.uint8 and image.ndim == 3 and image.shape[2] == 3:
        return 'bgr8'
    raise MessageError(f'image: expected uint8 (H, W) or (H, W, 3), got {image.dtype} {image.shape}')


def _upper_eight(samples: ImageArray, bits: int) -> npt.NDArray[np.uint8]:
    return np.minimum(samples >> (bits - 8), 255).astype(np.uint8)


def _converted(pixels: ImageArray, code: int, encoding: str) -> npt.NDArray[np.uint8]:
    convert: Callable[[ImageArray, int], npt.NDArray[np.uint8]] = cv2.cvtColor
    size = f'{pixels.shape[1]}x{pixels.shape[0]}'
    if code in _PAIRED and pixels.shape[1] % 2:  # OpenCV 4.6 converts it, into rows that do not fit
        raise MessageError(f'image of {size} pixels cannot be {encoding}: expected an even width')
    try:
        return convert(pixels, code)
    except cv2.error as error:
        reason = str(error).strip().splitlines()[-1]
        raise MessageError(f'image of {size} pixels cannot be {encoding}: {reason}') from None
