"""Whether two frames show a motion: tracks through noise find something everywhere, and some of it agrees."""

from __future__ import annotations

import cv2
import numpy as np

from motion_detect_ros.core.geometry.warp import apply, at_scale, stabilise
from motion_detect_ros.core.types import ByteArray, DoubleArray, FloatArray, PreparedFrame

#: Inliers closer to the motion than this agree too well for chance, working-resolution px: noise leaves 1.5 and more.
CLOSE_PX = 1.0
#: Least correlation of the stabilised pair: noise reaches 0.1, street scenes with strong parallax have 0.7 and more.
MIN_CORRELATION = 0.3
#: Frames are compared at this width, as details of a scene in depth do not fit one motion; less than the light that
#: changes over this part of it, pixels.
WIDTH_PX, BACKGROUND_PX = 160, 31
#: Tracks that go as was expected, share of those that go as was measured, from which what was expected is right.
RIVAL_SHARE = 0.2


def agrees(previous: PreparedFrame, frame: PreparedFrame, matrix: DoubleArray, residual_px: float) -> bool:
    """Whether ``previous``, warped by (3, 3) ``matrix`` (full resolution), looks like ``frame``.

    residual_px: of the inliers, full-resolution pixels; where it is small the answer is True without a look.
    """
    if residual_px * frame.scale <= CLOSE_PX:
        return True
    height, width = frame.gray.shape
    size = (min(WIDTH_PX, width), max(1, round(height * min(1.0, WIDTH_PX / width))))
    shrunk = [cv2.resize(each.gray, size, interpolation=cv2.INTER_AREA) for each in (previous, frame)]
    return _correlation(stabilise(shrunk[0], at_scale(matrix, size[0] / frame.width)), shrunk[1]) >= MIN_CORRELATION


def agrees_rather(
    earlier: FloatArray, later: FloatArray, measured: DoubleArray, expected: DoubleArray, near_px: float,
    nearby_px: float,
) -> bool:
    """Whether tracks go with the ``measured`` warp (3, 3) and next to none with the ``expected`` one.

    A camera that is jerked takes all of them along; what covers the ground for a moment, only those on it.
    earlier, later: (N, 2) of the tracks; near_px: largest distance to the measured warp, nearby_px: to the other.
    """
    with_measured = np.count_nonzero(_distance(earlier, later, measured) <= near_px)
    with_expected = np.count_nonzero(_distance(earlier, later, expected) <= nearby_px)
    return bool(with_expected < RIVAL_SHARE * with_measured)


def _distance(earlier: FloatArray, later: FloatArray, matrix: DoubleArray) -> FloatArray:
    x, y = (apply(matrix, earlier) - later).T
    return np.asarray(np.hypot(x, y), np.float32)


def _correlation(first: ByteArray, second: ByteArray) -> float:
    """Normalised cross-correlation, -1 to 1, of what differs from its surroundings; 0 where nothing does."""
    a, b = _details(first), _details(second)
    power = float(np.sqrt((a * a).sum() * (b * b).sum()))
    return float((a * b).sum()) / power if power > 0.0 else 0.0


def _details(gray: ByteArray) -> FloatArray:
    values = gray.astype(np.float32)
    details: FloatArray = values - cv2.blur(values, (BACKGROUND_PX, BACKGROUND_PX))
    return details
