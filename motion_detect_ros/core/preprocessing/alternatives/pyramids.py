"""Gaussian and Laplacian image pyramids, for coarse-to-fine methods (direct ego-motion, flow, blending).

Source: Burt and Adelson 1983, with the 5 x 5 binomial kernel (1 4 6 4 1)/16 in each direction. Level 0 is the image;
each further level has half the sides, rounded up. A pixel (x, y) of a level lies at (2 x, 2 y) of the one before.
"""

from __future__ import annotations

from itertools import pairwise

import cv2
import numpy as np
import numpy.typing as npt

from motion_detect_ros.core.errors import FrameError
from motion_detect_ros.core.types import ByteArray, FloatArray


def gaussian_pyramid(image: ByteArray | FloatArray, levels: int, min_side_px: int = 1) -> list[FloatArray]:
    """The image and up to ``levels`` smaller ones, none with a side under ``min_side_px``.

    image: (H, W) grey levels. Returns float32 arrays, largest first.
    Raises: FrameError for anything but a grey image with pixels.
    """
    pyramid = [_checked(image)]
    while len(pyramid) <= levels and min(pyramid[-1].shape) > max(1, 2 * (min_side_px - 1)):
        pyramid.append(reduce(pyramid[-1]))
    return pyramid


def laplacian_pyramid(image: ByteArray | FloatArray, levels: int, min_side_px: int = 1) -> list[FloatArray]:
    """Each level of the Gaussian pyramid less the next one expanded; the smallest level unchanged.

    Arguments and result as in ``gaussian_pyramid``; ``reconstruct`` gives the image back.
    """
    gaussian = gaussian_pyramid(image, levels, min_side_px)
    details = [fine - expand(coarse, fine.shape) for fine, coarse in pairwise(gaussian)]
    return [*details, gaussian[-1]]


def reconstruct(laplacian: list[FloatArray]) -> FloatArray:
    """The image of a Laplacian pyramid, (H, W) float32, exact to rounding."""
    image = laplacian[-1]
    for detail in reversed(laplacian[:-1]):
        image = detail + expand(image, detail.shape)
    return image


def reduce(image: FloatArray) -> FloatArray:
    """Smoothed, then every second pixel: g_l = REDUCE(g_{l-1}), Burt and Adelson 1983, equation 1.

    image: (H, W) float32. Returns ((H + 1) // 2, (W + 1) // 2) float32.
    """
    smaller: FloatArray = cv2.pyrDown(image)
    return smaller


def expand(image: FloatArray, shape: tuple[int, ...]) -> FloatArray:
    """Interpolated to ``shape`` (H, W), the level before: EXPAND, Burt and Adelson 1983, equation 2.

    image: ((H + 1) // 2, (W + 1) // 2) float32. Returns (H, W) float32.
    """
    larger: FloatArray = cv2.pyrUp(image, dstsize=(shape[1], shape[0]))
    return larger


def _checked(image: npt.NDArray[np.generic]) -> FloatArray:
    if image.ndim != 2 or image.size == 0:
        raise FrameError(f'pyramid: expected a grey image of shape (H, W), got {image.shape}')
    return image.astype(np.float32)
