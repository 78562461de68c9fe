"""From a camera image to the grey, denoised, working-resolution frame that every stage uses."""

from __future__ import annotations

import math

import cv2
import numpy as np
import numpy.typing as npt

from motion_detect_ros.core.config import PreprocessingConfig
from motion_detect_ros.core.errors import FrameError
from motion_detect_ros.core.preprocessing.alternatives.overlay_mask import OverlayFinder
from motion_detect_ros.core.preprocessing.brightness import Brightness
from motion_detect_ros.core.preprocessing.scene_mask import is_on_image, regions_mask
from motion_detect_ros.core.regions import Region, parse_regions
from motion_detect_ros.core.types import BoolArray, ByteArray, PreparedFrame

#: Smallest side of a working-resolution image that the flow pyramid can handle, pixels.
MIN_SIDE_PX = 32
#: Images are not enlarged by more: noise floors and gates in pixels of the image as it comes would not fit any longer.
MAX_ENLARGEMENT = 2.0
#: More are not told: there may be images of any sizes.
MAX_COMPLAINTS = 10


class Preprocessor:
    """Turns images, in their order, into ``PreparedFrame``.

    ``complaints``: which ignored regions were not on an image so far, in words, each once.
    """

    def __init__(self, config: PreprocessingConfig) -> None:
        self._config = config
        self._max_width_px = config.max_width_px
        self._regions = parse_regions(config.ignore_regions)
        self.complaints: tuple[str, ...] = ()
        self._ignored: dict[tuple[int, int], BoolArray | None] = {}
        self._overlay = OverlayFinder()
        self._brightness = Brightness()

    def limit_width(self, share: float) -> None:
        """From the next frame on the working width is this share, 0 .. 1, of ``max_width_px`` at most, but no side
        smaller than can be worked on.
        """
        before, self._max_width_px = self._max_width_px, round(share * self._config.max_width_px)
        if self._max_width_px == before:
            return
        self._ignored.clear()
        self._overlay.reset()

    def reset(self) -> None:
        """Clear the overlays detected and the brightness followed so far."""
        self._overlay.reset()
        self._brightness.reset()

    def process(self, image: npt.NDArray[np.uint8], stamp_ns: int) -> PreparedFrame:
        """Grey, of the working width, denoised, of even brightness, with the mask of pixels that show
        the scene.

        image: (H, W) grey or (H, W, 3) BGR, uint8.
        Raises: FrameError for another shape or type, or a side too small to work on.
        """
        height, width = _checked_size(image)
        gray = image if image.ndim == 2 else cv2.cvtColor(image, cv2.COLOR_BGR2GRAY)
        least = math.ceil(MIN_SIDE_PX * width / min(width, height))
        most = min(self._config.max_width_px, max(self._max_width_px, least))
        gray, scale = at_working_width(gray, self._config.min_width_px, most)
        if min(gray.shape) < MIN_SIDE_PX:
            raise FrameError(f'image: expected at least {MIN_SIDE_PX} px a side at working resolution, '
                             f'got {gray.shape[1]}x{gray.shape[0]}')
        if self._config.median_kernel_px > 1:
            gray = cv2.medianBlur(gray, self._config.median_kernel_px | 1)
        if self._config.mean_shift_px > 0:
            gray = mean_shift(gray, self._config.mean_shift_px, self._config.mean_shift_gray)
        gray = _own_bytes(gray, image)
        mask = self._mask(gray, width, height, stamp_ns)
        return PreparedFrame(self._brightness.step(gray, stamp_ns, mask), scale, width, height, stamp_ns, mask)

    def _mask(self, gray: ByteArray, width: int, height: int, stamp_ns: int) -> BoolArray | None:
        """(h, w), False in ignored regions and detected overlays; None without any."""
        if (width, height) not in self._ignored:
            self._complain(width, height)
            top = (Region(0, 0, width, self._config.ignore_top_px),) if self._config.ignore_top_px else ()
            self._ignored = {(width, height): regions_mask(top + self._regions, width, height, gray.shape)}
        ignored = self._ignored[width, height]
        overlay = self._overlay.step(gray, stamp_ns) if self._config.find_overlay else None
        if ignored is None or overlay is None:
            return overlay if ignored is None else ignored
        both: BoolArray = ignored & overlay
        return both

    def _complain(self, width: int, height: int) -> None:
        new = (f'preprocessing.ignore_regions: region {",".join(map(str, region))} is not on the {width}x{height} '
               'picture, and left out' for region in self._regions if not is_on_image(region, width, height))
        self.complaints = tuple(dict.fromkeys((*self.complaints, *new)))[:MAX_COMPLAINTS]


def at_working_width(
    gray: npt.NDArray[np.uint8], least_px: int, most_px: int,
) -> tuple[npt.NDArray[np.uint8], float]:
    """The image, (H, W), from ``least_px`` to ``most_px`` wide, and how many times as large as before.

    Narrower images are enlarged by ``MAX_ENLARGEMENT`` at most; all windows, from the tracker's to the score's, are
    made for objects as large as a picture of the default width shows them.
    """
    height, width = gray.shape
    scale = min(max(1.0, min(MAX_ENLARGEMENT, least_px / width)), most_px / width)
    if scale == 1.0:
        return gray, scale
    size = (round(width * scale), max(1, round(height * scale)))
    method = cv2.INTER_AREA if scale < 1.0 else cv2.INTER_CUBIC
    return np.asarray(cv2.resize(gray, size, interpolation=method), np.uint8), scale


def mean_shift(gray: ByteArray, radius_px: int, band_gray: float) -> ByteArray:
    """Mean-shift filtered: every pixel takes the grey value of its mode; smooths regions and keeps edges.

    gray: (H, W) uint8; radius_px, band_gray: half the sides of the kernel in the image and in grey levels.
    Source: Comaniciu and Meer 2002, on two levels of a pyramid.
    """
    three_channels = math.sqrt(3.0)  # the distance in grey, measured in colour
    smooth: ByteArray = cv2.pyrMeanShiftFiltering(
        cv2.merge([gray] * 3), radius_px, band_gray * three_channels, maxLevel=1)[..., 0]
    return smooth


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


def _own_bytes(gray: npt.NDArray[np.generic], image: npt.NDArray[np.uint8]) -> ByteArray:
    """Contiguous, and not sharing memory with ``image``: the caller may reuse its buffer while the frame is kept."""
    made = np.ascontiguousarray(gray, dtype=np.uint8)
    return made.copy() if np.may_share_memory(made, image) else made
