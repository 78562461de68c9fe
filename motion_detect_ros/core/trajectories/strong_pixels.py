"""The pixels of an object around a cluster of points: those near the peak gain of the photometric test."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from motion_detect_ros.core.config import ObjectsConfig
from motion_detect_ros.core.detection.patches import connected_pixels
from motion_detect_ros.core.detection.photometric import PhotometricTest
from motion_detect_ros.core.geometry.boxes import Box
from motion_detect_ros.core.geometry.order_statistics import percentile
from motion_detect_ros.core.kernels import kernel
from motion_detect_ros.core.types import BoolArray, FloatArray

#: Fewer foreground pixels than this are noise.
MIN_PIXELS = 6
#: Fewest points beside a soft shadow.
MIN_SOLID_POINTS = 3
#: The gain that a patch's strongest pixels reach, as a percentile.
PEAK_PERCENTILE = 90.0


@dataclass(frozen=True)
class Outline:
    """``number`` of some pixels of a region, and ``bounds``: left, top, right, bottom of them in it; ``low``, ``high``:
    (2,) bounds of the points among them, pixels of the image.
    """

    number: int
    bounds: list[int]
    low: FloatArray
    high: FloatArray


def strong_pixels(test: PhotometricTest, places: FloatArray, region: Box, config: ObjectsConfig) -> BoolArray | None:
    """(h, w) foreground near the peak gain of the components that touch a place; None with too few pixels.

    test: of the region; places: (n, 2) pixels in it.
    """
    mask = test.foreground
    count, labels = connected_pixels(mask, config.closing_px)
    strong = np.empty_like(mask)
    number = _strong_pixels(mask, test.gain, labels, region.left, region.top, places, config.peak_share,
                            np.zeros(count, np.bool_), np.empty(mask.size, np.float32), strong)
    return strong if number >= MIN_PIXELS else None


def outlines(strong: BoolArray, shadow: BoolArray, places: FloatArray, region: Box) -> tuple[Outline, Outline | None]:
    """Of all strong pixels and places, and of those outside of a shadow: None with too few of either.

    strong, shadow: (h, w) of the region; places: (n, 2) pixels in it; at least one of each.
    """
    bounds, edges = np.empty((2, 5), np.int64), np.empty((4, 2), np.float32)
    points = _outlines(strong, shadow, region.left, region.top, places, bounds, edges)
    (number, *whole), (number_outside, *outside) = bounds.tolist()
    enough = points >= MIN_SOLID_POINTS and number_outside >= MIN_PIXELS
    return (Outline(number, whole, edges[0], edges[1]),
            Outline(number_outside, outside, edges[2], edges[3]) if enough else None)


@kernel()
def _strong_pixels(  # type: ignore[no-untyped-def]
    mask, gain, labels, left, top, places, peak_share, touched, gains, strong,
):
    """``strong``: (h, w) pixels of ``mask`` whose label is that of a pixel at or beside a place, and whose gain is over
    this share of the peak of all of those; returns their number, 0 for few of any gain.

    places: (n, 2) in the image, the masks are at left, top of it; touched: (labels,) False; gains: (h * w,).
    """
    height, width = mask.shape
    for n in range(len(places)):
        column, row = int(np.rint(places[n, 0])) - left, int(np.rint(places[n, 1])) - top
        for r in range(max(0, row - 1), min(height, row + 2)):
            for c in range(max(0, column - 1), min(width, column + 2)):
                touched[labels[r, c]] = True
    touched[0] = False
    count = number = 0
    for r in range(height):
        for c in range(width):
            strong[r, c] = mask[r, c] and touched[labels[r, c]]
            if strong[r, c]:
                gains[count] = gain[r, c]
                count += 1
    if count < MIN_PIXELS:
        return 0
    limit = np.float32(peak_share * percentile(gains[:count], PEAK_PERCENTILE))
    for r in range(height):
        for c in range(width):
            strong[r, c] = strong[r, c] and gain[r, c] > limit
            number += strong[r, c]
    return number


@kernel()
def _outlines(strong, shadow, left, top, places, bounds, edges):  # type: ignore[no-untyped-def]
    """Number of the places (n, 2) outside of a shadow, (h, w) at left, top of the image as ``strong`` is.

    bounds: (2, 5) number, left, top, right, bottom of the strong pixels, and of those outside of it; edges: (4, 2)
    lowest and highest of the places, and of those outside.
    """
    height, width = strong.shape
    points = 0
    for side in range(2):
        bounds[side, 0], bounds[side, 1], bounds[side, 2], bounds[side, 3], bounds[side, 4] = 0, width, height, 0, 0
        for axis in range(2):
            edges[2 * side, axis], edges[2 * side + 1, axis] = np.inf, -np.inf
    for n in range(len(places)):
        outside = not shadow[int(np.rint(places[n, 1])) - top, int(np.rint(places[n, 0])) - left]
        points += outside
        for side in range(2 if outside else 1):
            for axis in range(2):
                edges[2 * side, axis] = min(edges[2 * side, axis], places[n, axis])
                edges[2 * side + 1, axis] = max(edges[2 * side + 1, axis], places[n, axis])
    for r in range(height):
        for c in range(width):
            if strong[r, c]:
                for side in range(1 if shadow[r, c] else 2):
                    bounds[side, 0] += 1
                    bounds[side, 1], bounds[side, 2] = min(bounds[side, 1], c), min(bounds[side, 2], r)
                    bounds[side, 3], bounds[side, 4] = max(bounds[side, 3], c + 1), max(bounds[side, 4], r + 1)
    return points
