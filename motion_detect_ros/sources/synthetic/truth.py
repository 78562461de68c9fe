"""What is true of a rendered frame: boxes, ground motion, flow and time to contact, all from the geometry."""

from __future__ import annotations

from typing import Any

import numpy as np
import numpy.typing as npt

from motion_detect_ros.core.types import TRUTH_DTYPE, BoolArray, DoubleArray, FloatArray, RecordArray
from motion_detect_ros.sources.synthetic.camera_path import CameraPose
from motion_detect_ros.sources.synthetic.compiled import inlined, kernel
from motion_detect_ros.sources.synthetic.raster import NOTHING, SUPER, Ids, draw_window
from motion_detect_ros.sources.synthetic.scene import GROUND, Scene, View, corner_depths_and_pixels, plane_maps

#: Boxes with less than this share of the object in view count neither way.
MIN_VISIBLE_SHARE = 0.4
#: Boxes that are smaller than this count neither way, pixels.
MIN_LONG_SIDE_PX, MIN_SHORT_SIDE_PX = 6, 3
#: A surface of the same body is taken for the same point where the depths agree to this share.
_SAME_DEPTH = 0.01
#: What lies on the picture's border is inside, whatever rounding makes of it, pixels.
_EDGE_PX = 1e-6


def ground_homography(previous: CameraPose, current: CameraPose) -> DoubleArray:
    """(3, 3) float64, previous pixel -> current pixel of points on the ground, lower right element 1."""
    matrix = current.ground_to_pixel() @ np.linalg.inv(previous.ground_to_pixel())
    return np.asarray(matrix / matrix[2, 2])


def relative_motion(previous: CameraPose, current: CameraPose) -> tuple[DoubleArray, DoubleArray]:
    """Rotation (3, 3) and translation (3,), metres, with X_current = rotation @ X_previous + translation."""
    rotation = current.rotation @ previous.rotation.T
    return np.asarray(rotation), np.asarray(current.rotation @ (previous.centre - current.centre))


def time_to_contact(scene: Scene, body: int, previous: CameraPose, current: CameraPose, where: DoubleArray) -> float:
    """Depth over closing speed of the body's centre, seconds; +inf where it does not come closer.

    Both along the current optical axis; the speed is that of camera and body over the last frame interval, so that
    turning on the spot is no approach. where: (2,) the body's place in the current frame, metres.
    """
    anchor = np.array([where[0], where[1], 0.5 * scene.size[body, 2]])
    axis, interval = current.rotation[2], current.time_s - previous.time_s
    moved = np.append(scene.speed[body] * interval * scene.ahead[body], 0.0) - (current.centre - previous.centre)
    closing = -float(moved @ axis) / interval
    return float((anchor - current.centre) @ axis) / closing if closing > 0 else float('inf')


def truth_boxes(
    scene: Scene, view: View, owner: Ids, masks: BoolArray, frame: int,
) -> tuple[RecordArray, npt.NDArray[np.int64]]:
    """Boxes of all cars, people and boxes of which at least one pixel is visible, and their bodies, sorted by id.

    Records have dtype ``TRUTH_DTYPE``; x, y is the first visible pixel column and row, w, h their number.
    ``moving`` is -1 where under 40 % of the object is in view or the box is tiny.
    """
    bounds = _bounds(owner, scene.body, len(scene.ident))
    bodies = np.flatnonzero((scene.ident > 0) & (bounds[:, 4] > 0))
    bodies = bodies[np.argsort(scene.ident[bodies], kind='stable')]
    boxes = np.zeros(len(bodies), TRUTH_DTYPE)
    for box, body in zip(boxes, bodies, strict=True):
        x0, y0, x1, y1, count = (int(value) for value in bounds[body])
        width, height = x1 - x0 + 1, y1 - y0 + 1
        clear = (count >= MIN_VISIBLE_SHARE * silhouette_px(scene, view, int(body), masks)
                 and max(width, height) >= MIN_LONG_SIDE_PX and min(width, height) >= MIN_SHORT_SIDE_PX)
        moving = int(scene.speed[body] > 0) if clear else -1
        box['frame'], box['id'], box['moving'] = frame, scene.ident[body], moving
        box['x'], box['y'], box['w'], box['h'] = x0, y0, width, height
    return boxes, bodies


def silhouette_px(scene: Scene, view: View, body: int, masks: BoolArray) -> float:
    """Pixels the body would fill with nothing in front of it and no picture border."""
    listed = np.flatnonzero(scene.body == body)
    listed = listed[np.isin(listed, view.listed)]
    _, pixels = corner_depths_and_pixels(scene, listed, view.to_pixel[listed])
    low = np.floor(pixels.min(axis=(0, 1))).astype(int) - 1
    high = np.ceil(pixels.max(axis=(0, 1))).astype(int) + 2
    window = (int(low[0]), int(low[1]), int(high[0] - low[0]), int(high[1] - low[1]))
    ids, _ = draw_window(scene, view, listed, masks, window)
    return float((ids != NOTHING).sum()) / SUPER ** 2


def exact_flow(
    scene: Scene, current: View, previous: View, owner: Ids, previous_ids: Ids,
) -> tuple[FloatArray, BoolArray]:
    """Displacement (H, W, 2) float32, pixels, of what each pixel shows since the previous frame, and what of it is
    a measurement: (H, W) bool, False where the point was hidden or outside before.

    Every patch is a plane, so its pixels move by a homography: previous plane map times the inverse of the current.
    """
    position = current.position - scene.speed[:, None] * scene.ahead * (current.pose.time_s - previous.pose.time_s)
    back = plane_maps(scene, current.listed, previous.pose, position)
    to_previous = np.zeros_like(back)
    to_previous[current.listed] = np.matmul(back[current.listed], current.to_patch[current.listed])
    flow = np.empty((*owner.shape, 2), np.float32)
    seen = np.empty(owner.shape, np.bool_)
    _flow(owner, to_previous, current.to_patch, previous_ids, previous.to_patch, scene.body, flow, seen)
    return flow, seen


@kernel
def _flow(
    owner: Any, h: Any, g: Any, previous_ids: Any, previous_to_patch: Any, body: Any, flow: Any, seen: Any,
) -> None:
    height, width = owner.shape
    for row in range(height):
        for column in range(width):
            p = owner[row, column]
            if p < 0:
                flow[row, column, 0], flow[row, column, 1], seen[row, column] = 0.0, 0.0, False
                continue
            scale = h[p, 2, 0] * column + h[p, 2, 1] * row + h[p, 2, 2]
            inverse = 1.0 / scale
            x = (h[p, 0, 0] * column + h[p, 0, 1] * row + h[p, 0, 2]) * inverse
            y = (h[p, 1, 0] * column + h[p, 1, 1] * row + h[p, 1, 2]) * inverse
            flow[row, column, 0], flow[row, column, 1] = column - x, row - y
            near = (g[p, 2, 0] * column + g[p, 2, 1] * row + g[p, 2, 2]) * inverse
            inside = -_EDGE_PX <= x <= width - 1 + _EDGE_PX and -_EDGE_PX <= y <= height - 1 + _EDGE_PX
            seen[row, column] = inside and _was_seen(
                p, x, y, near, previous_ids, previous_to_patch, body)


@inlined
def _was_seen(p: int, x: float, y: float, near: float, ids: Any, to_patch: Any, body: Any) -> bool:
    """Whether the sample nearest to (x, y) of the previous frame shows patch ``p``, or its body at the same depth."""
    q = ids[int((y + 0.5) * SUPER), int((x + 0.5) * SUPER)]
    if q == p or q < 0:
        return bool(q == p)
    if body[q] != body[p] or p == GROUND:
        return False
    g = to_patch[q]
    return bool(abs(g[2, 0] * x + g[2, 1] * y + g[2, 2] - near) <= _SAME_DEPTH * near)


@kernel
def _bounds(owner: Any, body: Any, bodies: int) -> Any:
    """(bodies, 5) int64: first column, first row, last column, last row, number of pixels."""
    out = np.zeros((bodies, 5), np.int64)
    out[:, 0], out[:, 1], out[:, 2], out[:, 3] = owner.shape[1], owner.shape[0], -1, -1
    for row in range(owner.shape[0]):
        for column in range(owner.shape[1]):
            if owner[row, column] <= GROUND:
                continue
            b = body[owner[row, column]]
            out[b, 0], out[b, 1] = min(out[b, 0], column), min(out[b, 1], row)
            out[b, 2], out[b, 3] = max(out[b, 2], column), max(out[b, 3], row)
            out[b, 4] += 1
    return out
