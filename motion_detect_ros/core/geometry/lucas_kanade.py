"""Points tracked from one image to another (Lucas and Kanade 1981; Bouguet 2001), by several threads."""

from __future__ import annotations

from collections.abc import Callable, Mapping
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
    moved, found, error = by_parts(lambda part: cv2.calcOpticalFlowPyrLK(
        one, other, points[part], None if start is None else start[part], **options), len(points))
    return moved, found, error


def by_parts(function: Callable[[slice], tuple[Any, ...]], count: int) -> tuple[Any, ...]:
    """What a function returns of parts of so many points, put together: arrays, a row for each point."""
    parts = HELPERS.parts(count, LEAST_POINTS)
    edges = [count * part // parts for part in range(parts + 1)]
    done = HELPERS.share(function, [slice(low, high) for low, high in pairwise(edges)])
    return done[0] if parts == 1 else tuple(np.concatenate(each) for each in zip(*done, strict=True))
