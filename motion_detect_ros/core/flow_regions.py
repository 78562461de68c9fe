"""Flow where something moves only: the regions around moving cells, and any flow method confined to them."""

from __future__ import annotations

import cv2
import numpy as np
import numpy.typing as npt

from motion_detect_ros.core.flow_backends import FlowFunction
from motion_detect_ros.core.robust import rayleigh_sigma
from motion_detect_ros.core.types import BoolArray, ByteArray, FloatArray

#: A cell moves that differs from the median of the field by so many deviations, and pixels at least.
MOVING_SIGMA, MIN_MOVING_PX = 4.0, 1.0
#: Pixels kept around moving cells, and computed around what is kept: methods are worst at the border of a picture.
AROUND_PX, CONTEXT_PX = 32, 16

Boxes = npt.NDArray[np.int64]


def flow_in_regions(
    flow: FlowFunction, current: ByteArray, earlier: ByteArray, boxes: Boxes, margin_px: int = CONTEXT_PX,
    start: FloatArray | None = None,
) -> FloatArray:
    """(h, w, 2) displacement as ``flow`` gives it, computed in ``boxes`` only; NaN everywhere else.

    current, earlier: (h, w) uint8; boxes: (n, 4) left, top, right, bottom, pixels, right and bottom exclusive;
    margin_px: computed around every box and not returned; start: (h, w, 2) first guess.
    """
    height, width = current.shape
    found = np.full((height, width, 2), np.nan, np.float32)
    for left, top, right, bottom in boxes:
        rows = slice(max(0, top - margin_px), min(height, bottom + margin_px))
        columns = slice(max(0, left - margin_px), min(width, right + margin_px))
        guess = None if start is None else np.ascontiguousarray(start[rows, columns])
        part = flow(np.ascontiguousarray(current[rows, columns]), np.ascontiguousarray(earlier[rows, columns]), guess)
        found[top:bottom, left:right] = part[
            top - rows.start:bottom - rows.start, left - columns.start:right - columns.start]
    return found


def moving_cells(shift: FloatArray) -> BoolArray:
    """(rows, columns) cells whose displacement between stabilised pictures is not that of most.

    shift: (rows, columns, 2) float32 pixels, NaN = unknown, which does not move.
    """
    error = shift - np.nanmedian(shift, axis=(0, 1)) if np.isfinite(shift).any() else shift
    length = np.hypot(error[..., 0], error[..., 1])
    known = length[np.isfinite(length)]
    sigma = rayleigh_sigma(known) if known.size else 0.0
    moving: BoolArray = length > max(MIN_MOVING_PX, MOVING_SIGMA * sigma)
    return moving


def regions_around(moving: BoolArray, width: int, height: int) -> Boxes:
    """(n, 4) boxes around moving cells of a grid over a picture, cut at its edges, none overlapping another's cells.

    left, top, right, bottom in pixels, on edges of cells.
    """
    rows, columns = moving.shape
    reach = [2 * int(np.ceil(AROUND_PX * count / size)) + 1 for count, size in ((columns, width), (rows, height))]
    near = cv2.dilate(moving.astype(np.uint8), np.ones(reach[::-1], np.uint8))
    while True:
        _, _, boxes, _ = cv2.connectedComponentsWithStats(near)
        before = np.count_nonzero(near)
        for left, top, wide, high, _ in boxes[1:]:
            near[top:top + high, left:left + wide] = 1
        if np.count_nonzero(near) == before:
            break
    edges = boxes[1:, [0, 1, 0, 1]] + np.pad(boxes[1:, 2:4], ((0, 0), (2, 0)))
    pixels: Boxes = np.rint(edges * np.array([width / columns, height / rows] * 2)).astype(np.int64)
    return pixels
