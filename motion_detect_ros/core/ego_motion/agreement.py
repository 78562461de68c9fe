"""Whether two frames show a motion: tracks through noise find something everywhere, and some of it agrees."""

from __future__ import annotations

import cv2
import numpy as np

from motion_detect_ros.core.geometry.resizing import shrunk
from motion_detect_ros.core.geometry.warp import at_scale, stabilise
from motion_detect_ros.core.preprocessing.scene_mask import WHOLE, scene_cells
from motion_detect_ros.core.types import ByteArray, DoubleArray, FloatArray, PreparedFrame

#: Inliers closer to the motion than this agree too well for chance, working-resolution px: noise leaves 1.5 and more.
CLOSE_PX = 1.0
#: Least correlation of the stabilised pair: noise reaches 0.1, street scenes with strong parallax have 0.7 and more.
MIN_CORRELATION = 0.3
#: Frames are compared at about this width, as details of a scene in depth do not fit one motion; less than the light
#: that changes over this part of it, pixels.
WIDTH_PX, BACKGROUND_PX = 160, 31
#: Two motions are compared in cells of so many pixels of frames of about this width; a cell goes with the one under
#: which its mean error and this, grey levels, are less than half as large. What was expected is right where it has at
#: least this share of the cells that what was measured has.
COMPARED_WIDTH_PX, CELL_PX, CELL_NOISE_GRAY, RIVAL_SHARE = 320, 8, 2.0, 0.2
#: Another motion that tracks agree on is the background's where this share of the cells goes with it, and so many times
#: as many as with the first one.
GOOD_PART, MORE = 0.1, 1.2


def agrees(previous: PreparedFrame, frame: PreparedFrame, matrix: DoubleArray, residual_px: float) -> bool:
    """Whether ``previous``, warped by (3, 3) ``matrix`` (full resolution), looks like ``frame``.

    residual_px: of the inliers, full-resolution pixels; where it is small the answer is True without a look. What the
    mask leaves out of either of them is not looked at: text and hull are alike without any motion.
    """
    if residual_px * frame.scale <= CLOSE_PX:
        return True
    (before, _), (now, scale) = (shrunk(each.gray, WIDTH_PX) for each in (previous, frame))
    scene = None
    if frame.mask is not None:
        scene = scene_cells(frame.mask, matrix, frame.scale, *now.shape).astype(np.float32)
    return _correlation(stabilise(before, at_scale(matrix, scale * frame.scale)), now, scene) >= MIN_CORRELATION


def agrees_rather(
    previous: PreparedFrame, frame: PreparedFrame, measured: DoubleArray, expected: DoubleArray,
) -> bool:
    """Whether ``frame`` looks like ``previous`` under ``measured``, and next to nowhere under ``expected``.

    A camera that is jerked takes all of the picture along; what covers the ground for a moment, only its own part.
    measured, expected: (3, 3) warps, full resolution.
    """
    of_measured, of_expected, _ = _cells_of(previous, frame, measured, expected)
    return of_expected < RIVAL_SHARE * of_measured


def shows_rather(previous: PreparedFrame, frame: PreparedFrame, rival: DoubleArray, measured: DoubleArray) -> bool:
    """Whether a good part of the picture goes with ``rival``, and clearly less with ``measured``: (3, 3) warps, full
    resolution.
    """
    of_rival, of_measured, cells = _cells_of(previous, frame, rival, measured)
    return of_rival > max(GOOD_PART * cells, MORE * of_measured)


def _cells_of(
    previous: PreparedFrame, frame: PreparedFrame, one: DoubleArray, other: DoubleArray,
) -> tuple[int, int, int]:
    """How many cells go with each of two motions, and not with the other one; and how many there are."""
    (before, _), (now, scale) = (shrunk(each.gray, COMPARED_WIDTH_PX) for each in (previous, frame))
    cells = (max(1, now.shape[1] // CELL_PX), max(1, now.shape[0] // CELL_PX))
    of_one, of_other = (
        cv2.resize(cv2.absdiff(stabilise(before, at_scale(matrix, scale * frame.scale)), now), cells,
                   interpolation=cv2.INTER_AREA).astype(np.float32) + CELL_NOISE_GRAY
        for matrix in (one, other))
    first, second = 2.0 * of_one < of_other, 2.0 * of_other < of_one
    if frame.mask is not None:
        scene = cv2.resize(frame.mask.astype(np.uint8), cells, interpolation=cv2.INTER_NEAREST) > 0
        first, second = first & scene, second & scene
    return int(np.count_nonzero(first)), int(np.count_nonzero(second)), first.size


def _correlation(first: ByteArray, second: ByteArray, scene: FloatArray | None) -> float:
    """Normalised cross-correlation, -1 to 1, of what differs from its surroundings; 0 where nothing does.

    scene: (h, w), 1 where the scene is seen, else 0; None = everywhere.
    """
    a, b = _details(first, scene), _details(second, scene)
    power = float(np.sqrt((a * a).sum() * (b * b).sum()))
    return float((a * b).sum()) / power if power > 0.0 else 0.0


def _details(gray: ByteArray, scene: FloatArray | None) -> FloatArray:
    values, window = gray.astype(np.float32), (BACKGROUND_PX, BACKGROUND_PX)
    if scene is None:
        return np.asarray(values - cv2.blur(values, window), np.float32)
    seen = np.maximum(cv2.blur(scene, window), np.float32(1.0 - WHOLE))
    return np.asarray(scene * (values - cv2.blur(scene * values, window) / seen), np.float32)
