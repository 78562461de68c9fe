"""Points tracked from one image to another (Lucas and Kanade 1981; Bouguet 2001), by several threads."""

from __future__ import annotations

from collections.abc import Mapping
from itertools import pairwise
from typing import Any

import cv2
import numpy as np

from motion_detect_ros.core.threads import HELPERS
from motion_detect_ros.core.types import ByteArray, FloatArray

#: Fewest points worth a thread: every call prepares the images anew.
LEAST_POINTS = 200

Tracked = tuple[FloatArray, Any, Any]


def lucas_kanade(
    one: ByteArray, other: ByteArray, points: FloatArray, start: FloatArray | None, options: Mapping[str, Any],
) -> Tracked:
    """As ``cv2.calcOpticalFlowPyrLK(one, other, points, start, **options)``.

    That is positions (N, 2) in ``other``, whether they were found (N, 1), and the errors (N, 1).

    The points are split where OpenCV itself has one thread only; what becomes of a point does not depend on others.
    """
    count = HELPERS.parts(len(points), LEAST_POINTS)
    if count == 1:
        return _call(one, other, points, start, options)
    edges = [len(points) * part // count for part in range(count + 1)]
    done = HELPERS.share(
        lambda part: _call(one, other, points[part], None if start is None else start[part], options),
        [slice(low, high) for low, high in pairwise(edges)])
    moved, found, error = (np.concatenate(each) for each in zip(*done, strict=True))
    return moved, found, error


def _call(
    one: ByteArray, other: ByteArray, points: FloatArray, start: FloatArray | None, options: Mapping[str, Any],
) -> Tracked:
    return cv2.calcOpticalFlowPyrLK(one, other, points, start, **options)
