"""Mask of the image that shows the scene: without ignored regions, for pixels and for cells of the flow grid."""

from __future__ import annotations

import cv2
import numpy as np

from motion_detect_ros.core.geometry.warp import at_scale, stabilise
from motion_detect_ros.core.regions import Region
from motion_detect_ros.core.types import BoolArray, DoubleArray

#: Share of a cell that must show the scene; the rest is rounding.
WHOLE = 1.0 - 1e-4


def regions_mask(
    regions: tuple[Region, ...], width: int, height: int, shape: tuple[int, int],
) -> BoolArray | None:
    """(h, w) = ``shape``: False for every pixel that shows any of ``regions`` of a ``width`` x ``height`` image.

    What of them is not on the image is nothing. None where no region is on it.
    """
    regions = tuple(region for region in regions if is_on_image(region, width, height))
    if not regions:
        return None
    across, down = shape[1] / width, shape[0] / height
    mask = np.ones(shape, np.bool_)
    for region in regions:
        right, bottom = (region.x + region.width) * across, (region.y + region.height) * down
        mask[int(region.y * down):int(np.ceil(bottom)), int(region.x * across):int(np.ceil(right))] = False
    return mask


def is_on_image(region: Region, width: int, height: int) -> bool:
    """Whether any of it is on a ``width`` x ``height`` image."""
    return region.x < width and region.y < height


def inner_scene(mask: BoolArray, reach_px: int) -> BoolArray:
    """(h, w): pixels of the scene at least so far, in both axes, from every pixel of the mask that shows none.

    Windows around them see nothing but the scene.
    """
    side = 2 * reach_px + 1
    return cv2.erode(mask.view(np.uint8), np.ones((side, side), np.uint8)).view(np.bool_)


class InnerScene:
    """``inner_scene``, kept while frames come with the same mask."""

    def __init__(self, reach_px: int) -> None:
        self._reach_px = reach_px
        self._mask: BoolArray | None = None
        self._inner: BoolArray | None = None

    def of(self, mask: BoolArray | None) -> BoolArray | None:
        """(h, w), None without a mask."""
        if mask is not self._mask:
            self._mask, self._inner = mask, None if mask is None else inner_scene(mask, self._reach_px)
        return self._inner


def scene_cells(mask: BoolArray, matrix: DoubleArray, scale: float, rows: int, columns: int) -> BoolArray:
    """(rows, columns): True for cells that show nothing but the scene, in both images.

    mask: (h, w), the same in both, as burnt-in text is; matrix: (3, 3) earlier pixel -> later pixel, full resolution;
    scale: working / full resolution. Where the earlier image shows text, the flow is invalid.
    """
    seen = mask & (stabilise(mask.astype(np.uint8), at_scale(matrix, scale)) > 0)
    return whole_cells(seen, rows, columns)


def whole_cells(mask: BoolArray, rows: int, columns: int) -> BoolArray:
    """(rows, columns): True for cells of a mask, (h, w), in which it is True everywhere."""
    share = cv2.resize(mask.astype(np.float32), (columns, rows), interpolation=cv2.INTER_AREA)
    whole: BoolArray = share > WHOLE
    return whole
