"""The worst frames, and the colours in which they are drawn."""

from __future__ import annotations

import numpy as np

from motion_detect_ros.core.types import TRUTH_DTYPE
from motion_detect_ros.results.error_pictures import (
    FALSE_BGR,
    FOUND_BGR,
    HIT_BGR,
    IGNORED_BGR,
    MISSED_BGR,
    draw_verdict,
    worst_frames,
)
from motion_detect_ros.results.metrics import judge_frame


def test_worst_frames_are_apart_and_have_errors() -> None:
    errors = {0: 1, 1: 9, 2: 8, 3: 0, 4: 5, 5: 5}
    assert worst_frames(errors, 2, 2) == [1, 4]
    assert worst_frames(errors, 9, 1) == [0, 1, 2, 4, 5]
    assert worst_frames({}, 3, 1) == []


def test_every_box_has_the_colour_of_its_fate() -> None:
    truth = np.array([(0, 1, 10, 10, 20, 20, 1), (0, 2, 50, 10, 20, 20, 1), (0, 3, 90, 60, 40, 40, -1)],
                     TRUTH_DTYPE)
    boxes = np.array([[12, 12, 20, 20], [10, 60, 20, 20], [95, 65, 20, 20]], np.float64)
    verdict = judge_frame(truth, boxes, 0.3)
    assert (verdict.hit.tolist(), verdict.ignored.tolist()) == ([True, False, False], [False, False, True])
    assert verdict.found.tolist() == [True, False]
    assert verdict.errors == 2
    canvas = draw_verdict(np.zeros((300, 200, 3), np.uint8), boxes, verdict)
    assert canvas.shape[0] > 300 and not canvas[200:300].any() and canvas[300:].any(), 'the legend covers nothing'
    for (x, y), color in (((10, 25), FOUND_BGR), ((32, 32), HIT_BGR), ((50, 25), MISSED_BGR),
                          ((10, 70), FALSE_BGR), ((95, 75), IGNORED_BGR)):
        assert tuple(map(int, canvas[y, x])) == color
