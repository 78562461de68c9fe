"""Regions of interest around moving cells, and any flow method confined to them."""

from __future__ import annotations

from functools import partial

import cv2
import numpy as np
import numpy.typing as npt

from motion_detect_ros.core.flow_methods.flow_function import FlowFunction
from motion_detect_ros.core.geometry.robust import rayleigh_sigma
from motion_detect_ros.core.geometry.warp import apply, at_scale, grid_points, inverse
from motion_detect_ros.core.types import BoolArray, ByteArray, DoubleArray, EgoMotion, FloatArray, PreparedFrame

#: A cell moves that differs from the median of the field by so many deviations, and pixels at least.
MOVING_SIGMA, MIN_MOVING_PX = 4.0, 1.0
#: Margin around moving cells, and context computed around it: methods are worst at the border of an image, pixels.
AROUND_PX, CONTEXT_PX = 32, 16

Boxes = npt.NDArray[np.int64]


class RegionsOfInterest:
    """Where flow is computed: everywhere in every ``full_every``-th frame, else around what moved last."""

    def __init__(self, full_every: int) -> None:
        self._full_every = full_every
        self.reset()

    def reset(self) -> None:
        """Clear the last flow: the next frame is computed in full."""
        self._last: FloatArray | None = None
        self._stamp_ns = self._since_full = 0

    def boxes(self, frame: PreparedFrame, ego: EgoMotion, grid: tuple[int, int]) -> Boxes | None:
        """(n, 4) regions of ``frame``, working pixels; None = everywhere.

        grid: rows and columns of the flow. Regions need the flow of the frame that ``ego`` starts from.
        """
        known = self._last is not None and self._last.shape[:2] == grid
        self._since_full = (self._since_full + 1) % self._full_every
        if self._full_every == 1 or not known or not ego.ok or self._stamp_ns != ego.prev_stamp_ns:
            self._since_full = 0
        if not self._since_full or self._last is None:
            return None
        height, width = frame.gray.shape
        moved = carried_flow(self._last, at_scale(ego.matrix, frame.scale), width, height)
        return regions_around(moving_cells(moved), width, height)

    def remember(self, shift: FloatArray, stamp_ns: int) -> None:
        """The flow that was found in the frame of ``stamp_ns``, (rows, columns, 2) working pixels."""
        self._last, self._stamp_ns = shift, stamp_ns


def confined(flow: FlowFunction, boxes: Boxes | None) -> FlowFunction:
    """``flow``, computed in ``boxes`` only; None = ``flow`` itself."""
    return flow if boxes is None else partial(flow_in_regions, flow, boxes)


def flow_in_regions(flow: FlowFunction, boxes: Boxes, current: ByteArray, reference: ByteArray, /) -> FloatArray:
    """(h, w, 2) displacement as ``flow`` gives it, computed in ``boxes`` only; NaN everywhere else.

    boxes: (n, 4) left, top, right, bottom, pixels, right and bottom exclusive; current, reference: (h, w) uint8.
    ``CONTEXT_PX`` are computed around every box and not returned.
    """
    height, width = current.shape
    found = np.full((height, width, 2), np.nan, np.float32)
    for left, top, right, bottom in boxes:
        rows = slice(max(0, top - CONTEXT_PX), min(height, bottom + CONTEXT_PX))
        columns = slice(max(0, left - CONTEXT_PX), min(width, right + CONTEXT_PX))
        part = flow(np.ascontiguousarray(current[rows, columns]), np.ascontiguousarray(reference[rows, columns]))
        found[top:bottom, left:right] = part[
            top - rows.start:bottom - rows.start, left - columns.start:right - columns.start]
    return found


def carried_flow(shift: FloatArray, matrix: DoubleArray, width: int, height: int) -> FloatArray:
    """(rows, columns, 2) the displacements of the previous image, warped into the current one.

    shift: (rows, columns, 2) displacement on a grid over the previous image, pixels, NaN = unknown; matrix: (3, 3)
    previous pixel -> current pixel; width, height: of both images. Unknown cells and those from outside are zero, the
    displacement of the ground between stabilised images.
    """
    rows, columns = shift.shape[:2]
    points = grid_points(rows, columns, width, height)
    before = apply(inverse(matrix), points)
    cells = (before + 0.5) * np.array([columns / width, rows / height], np.float32) - 0.5
    known = cv2.remap(np.nan_to_num(shift), cells.astype(np.float32), None, cv2.INTER_LINEAR)
    moved: FloatArray = apply(matrix, before + known) - points
    moved[~np.isfinite(moved).all(axis=-1)] = 0.0
    return moved


def moving_cells(shift: FloatArray) -> BoolArray:
    """(rows, columns) cells whose displacement between stabilised images differs from the median.

    shift: (rows, columns, 2) float32 pixels, NaN = unknown, not moving.
    """
    error = shift - np.nanmedian(shift, axis=(0, 1)) if np.isfinite(shift).any() else shift
    length = np.hypot(error[..., 0], error[..., 1])
    known = length[np.isfinite(length)]
    sigma = rayleigh_sigma(known) if known.size else 0.0
    moving: BoolArray = length > max(MIN_MOVING_PX, MOVING_SIGMA * sigma)
    return moving


def regions_around(moving: BoolArray, width: int, height: int) -> Boxes:
    """(n, 4) boxes around moving cells of a grid over an image, cut at its edges, none overlapping another's cells.

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
