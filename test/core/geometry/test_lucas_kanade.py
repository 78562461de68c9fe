"""Points tracked by several threads, against OpenCV's own answer for all of them at once."""

from __future__ import annotations

import cv2
import numpy as np
import pytest

from motion_detect_ros.core.geometry.lucas_kanade import LEAST_POINTS, lucas_kanade
from motion_detect_ros.core.threads import limited


def images() -> tuple[np.ndarray, np.ndarray]:
    """The second one shows the first 2 px further right."""
    noise = cv2.GaussianBlur(np.random.default_rng(4).normal(size=(240, 324)), (0, 0), 1.5)
    ground = cv2.normalize(noise, None, 0, 255, cv2.NORM_MINMAX).astype(np.uint8)
    return np.ascontiguousarray(ground[:, 2:322]), np.ascontiguousarray(ground[:, :320])


@pytest.mark.parametrize('threads', [1, 2, 4])
@pytest.mark.parametrize('count', [1, 2 * LEAST_POINTS - 1, 1001])
@pytest.mark.parametrize('guessed', [False, True])
def test_the_answer_is_that_of_one_call(threads: int, count: int, guessed: bool) -> None:
    one, other = images()
    points = np.random.default_rng(5).uniform(-5.0, 245.0, (count, 2)).astype(np.float32)  # some are not on the image
    start = points + np.float32(1.5) if guessed else None
    flags = cv2.OPTFLOW_USE_INITIAL_FLOW if guessed else 0
    options = {'winSize': (9, 9), 'maxLevel': 0 if guessed else 2, 'flags': flags}
    with limited(threads):
        moved, found, _ = lucas_kanade(one, other, points, None if start is None else start.copy(), options)
    expected, wanted, _ = cv2.calcOpticalFlowPyrLK(one, other, points, start, **options)
    np.testing.assert_array_equal(found, wanted)
    np.testing.assert_array_equal(moved[found.ravel() > 0], expected[wanted.ravel() > 0])
    if count == 1001:
        way = (moved - points)[found.ravel() > 0]
        assert np.median(way, axis=0) == pytest.approx([2.0, 0.0], abs=0.05)
