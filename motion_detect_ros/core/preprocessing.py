"""From a camera image to the grey, denoised, working-resolution frame that every stage looks at."""

from __future__ import annotations

import cv2
import numpy as np
import numpy.typing as npt

from motion_detect_ros.core.config import PreprocessingConfig
from motion_detect_ros.core.errors import FrameError
from motion_detect_ros.core.types import ByteArray, PreparedFrame

#: Smallest side of a working-resolution image that the flow pyramid can still handle, pixels.
MIN_SIDE_PX = 32


class Preprocessor:
    """Turns images into ``PreparedFrame``; holds no state."""

    def __init__(self, config: PreprocessingConfig) -> None:
        self._config = config

    def process(self, image: npt.NDArray[np.uint8], stamp_ns: int) -> PreparedFrame:
        """Grey, shrunk to ``max_width_px`` and median filtered.

        image: (H, W) grey or (H, W, 3) BGR, uint8.
        Raises: FrameError for another shape or type, or a side too small to work on.
        """
        height, width = _checked_size(image)
        gray = image if image.ndim == 2 else cv2.cvtColor(image, cv2.COLOR_BGR2GRAY)
        scale = min(1.0, self._config.max_width_px / width)
        if scale < 1.0:
            size = (round(width * scale), round(height * scale))
            gray = cv2.resize(gray, size, interpolation=cv2.INTER_AREA)
        if min(gray.shape) < MIN_SIDE_PX:
            raise FrameError(f'image: expected at least {MIN_SIDE_PX} px a side at working resolution, '
                             f'got {gray.shape[1]}x{gray.shape[0]}')
        if self._config.median_kernel_px > 1:
            gray = cv2.medianBlur(gray, self._config.median_kernel_px | 1)
        return PreparedFrame(_as_bytes(gray), scale, width, height, stamp_ns)


def _checked_size(image: npt.NDArray[np.uint8]) -> tuple[int, int]:
    """Height and width of a usable image. Raises: FrameError."""
    if not isinstance(image, np.ndarray) or image.dtype != np.uint8:
        got = getattr(image, 'dtype', type(image).__name__)
        raise FrameError(f'image: expected a uint8 array, got {got}')
    if image.ndim not in (2, 3) or (image.ndim == 3 and image.shape[2] != 3):
        raise FrameError(f'image: expected shape (H, W) or (H, W, 3), got {image.shape}')
    if image.size == 0:
        raise FrameError(f'image: expected at least one pixel, got shape {image.shape}')
    return image.shape[0], image.shape[1]


def _as_bytes(image: npt.NDArray[np.generic]) -> ByteArray:
    return np.ascontiguousarray(image, dtype=np.uint8)
