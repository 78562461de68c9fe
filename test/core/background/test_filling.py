"""What is filled in against box filters of OpenCV, and by hand."""

from __future__ import annotations

import cv2
import numpy as np
import pytest

from motion_detect_ros.core.background.filling import filled_from_around


def by_box_filters(flow: np.ndarray, hidden: np.ndarray) -> np.ndarray:
    """In double precision; every window's mean of the known cells, the smallest window that knows enough."""
    seen = (~hidden).astype(np.float64)
    known = np.where(hidden[..., None], 0.0, flow.astype(np.float64))
    filled = known.copy()
    missing = hidden.copy()
    for size in (9, 17, 33, 65, 129):
        share = cv2.blur(seen, (size, size))
        reached = missing & (share > 0.02)
        filled[reached] = cv2.blur(known, (size, size))[reached] / share[reached][:, None]
        missing &= ~reached
    return filled


@pytest.mark.parametrize('shape', [(72, 240), (120, 90), (20, 31), (3, 200), (200, 2), (1, 50), (40, 1)])
@pytest.mark.parametrize('hole', ['blocks', 'left', 'nearly all', 'all', 'nothing'])
def test_filled_cells_are_means_of_the_smallest_window_that_knows_enough(shape: tuple[int, int], hole: str) -> None:
    random = np.random.default_rng(0)
    flow = random.normal(3.0, 2.0, (*shape, 2)).astype(np.float32)
    hidden = random.random(shape) < {'nearly all': 0.985, 'all': 2.0, 'nothing': -1.0}.get(hole, 0.05)
    if hole == 'blocks':
        hidden[shape[0] // 4:shape[0] // 2, shape[1] // 3:] = True
    if hole == 'left':
        hidden[:, :shape[1] * 2 // 3] = True
    flow[hidden] = np.nan
    filled = filled_from_around(flow, hidden)
    assert filled.dtype == np.float32
    np.testing.assert_array_equal(filled[~hidden], flow[~hidden])
    np.testing.assert_allclose(filled, by_box_filters(flow, hidden), rtol=1e-5, atol=1e-5)


def test_a_hole_in_two_flows_takes_each_from_its_side() -> None:
    flow = np.zeros((40, 60, 2), np.float32)
    flow[:, 30:] = [4.0, -2.0]
    hidden = np.zeros((40, 60), bool)
    hidden[10:30, 25:35] = True
    filled = filled_from_around(np.where(hidden[..., None], np.float32(100.0), flow), hidden)
    np.testing.assert_allclose(filled[20, [25, 34]], [[0.0, 0.0], [4.0, -2.0]], atol=1e-6)
