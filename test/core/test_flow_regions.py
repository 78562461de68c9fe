"""Flow in regions only, and the last flow as first guess: against hand-made fields, and on a rendered square."""

from __future__ import annotations

import cv2
import numpy as np
import pytest

from motion_detect_ros.core import optical_flow
from motion_detect_ros.core.config import WARM_METHODS, OpticalFlowConfig, PipelineConfig
from motion_detect_ros.core.errors import ConfigError
from motion_detect_ros.core.flow_backends import make_flow
from motion_detect_ros.core.flow_regions import flow_in_regions, moving_cells, regions_around
from motion_detect_ros.core.optical_flow import OpticalFlowStage, both_ways
from motion_detect_ros.core.types import EgoMotion, EgoStatus, PreparedFrame
from motion_detect_ros.core.warm_start import carried, turned_round
from motion_detect_ros.core.warp import apply, grid_points

WIDTH, HEIGHT, PERIOD_NS = 320, 240, 40_000_000
GROUND = np.array([[1, 0, 4], [0, 1, -8], [0, 0, 1]], float)
SIDE, STEP = 48, np.array([10.0, -8.0])
WORLD = np.random.default_rng(1).normal(size=(HEIGHT + 200, WIDTH + 200))
THING = np.random.default_rng(2).normal(size=(SIDE, SIDE))


def smooth(noise: np.ndarray) -> np.ndarray:
    return (128 + 130 * cv2.GaussianBlur(noise, (0, 0), 1.5)).clip(0, 255).astype(np.uint8)


def picture(index: int) -> np.ndarray:
    """Ground that moves by ``GROUND`` a frame, and a square at (100, 120) that moves by ``STEP``."""
    left, top = 100 - 4 * index, 100 + 8 * index
    image = smooth(WORLD)[top:top + HEIGHT, left:left + WIDTH].copy()
    x, y = corner(index)
    image[y:y + SIDE, x:x + SIDE] = smooth(THING)
    return image


def corner(index: int) -> np.ndarray:
    return (np.array([100, 120]) + index * STEP).astype(int)


def run(config: OpticalFlowConfig, frames: int) -> list[np.ndarray]:
    stage = OpticalFlowStage(PipelineConfig(optical_flow=config))
    flows = []
    for index in range(frames):
        status = EgoStatus.OK if index else EgoStatus.FIRST_FRAME
        stamp = (index + 1) * PERIOD_NS
        ego = EgoMotion(GROUND if index else np.eye(3), np.eye(6), status, stamp, max(stamp - PERIOD_NS, PERIOD_NS))
        flows.append(stage.process(PreparedFrame(picture(index), 1.0, WIDTH, HEIGHT, stamp), ego).flow)
    return flows


def test_inside_its_regions_it_is_the_method_on_the_cut_and_nan_elsewhere() -> None:
    current, earlier = picture(1), picture(0)
    dis = make_flow(OpticalFlowConfig())
    found = flow_in_regions(dis, current, earlier, np.array([[40, 60, 140, 160], [300, 0, 320, 40]]), 8)
    np.testing.assert_array_equal(
        found[60:160, 40:140], dis(current[52:168, 32:148].copy(), earlier[52:168, 32:148].copy())[8:-8, 8:-8])
    assert np.isfinite(found[:40, 300:]).all()
    found[60:160, 40:140], found[:40, 300:] = np.nan, np.nan
    assert np.isnan(found).all()


def test_a_region_of_everything_is_the_whole_flow() -> None:
    current, earlier = picture(1), picture(0)
    dis = make_flow(OpticalFlowConfig())
    np.testing.assert_array_equal(
        flow_in_regions(dis, current, earlier, np.array([[0, 0, WIDTH, HEIGHT]])), dis(current, earlier))


def test_moving_cells_and_the_boxes_around_them() -> None:
    shift = np.random.default_rng(0).normal(0, 0.1, (60, 80, 2)).astype(np.float32) + np.float32(3.0)
    shift[20:24, 30:35] += 2.0
    shift[50, 70] = np.nan
    moving = moving_cells(shift)
    assert np.argwhere(moving).tolist() == [[row, column] for row in range(20, 24) for column in range(30, 35)]
    # cells of 4 px, 32 px around: columns 22 to 42, rows 12 to 31
    assert regions_around(moving, 320, 240).tolist() == [[88, 48, 172, 128]]
    moving[59, 79] = True
    assert regions_around(moving, 320, 240).tolist() == [[88, 48, 172, 128], [284, 204, 320, 240]]
    assert regions_around(np.zeros((60, 80), bool), 320, 240).shape == (0, 4)


def test_regions_that_meet_become_one() -> None:
    moving = np.zeros((60, 80), bool)
    moving[10, 20], moving[25, 35] = True, True
    assert regions_around(moving, 320, 240).tolist() == [[48, 8, 176, 136]]


def test_between_full_frames_the_flow_is_of_the_square_and_what_is_around_it() -> None:
    flows = run(OpticalFlowConfig(full_every=3), 8)
    whole = run(OpticalFlowConfig(), 8)
    known = [np.isfinite(flow[..., 0]).mean() for flow in flows]
    for index in (1, 4, 7):
        np.testing.assert_array_equal(flows[index], whole[index])
    for index in (2, 3, 5, 6):
        assert 0.05 < known[index] < 0.4
        x, y = corner(index) // 4 + 3
        on_it = flows[index][y:y + 6, x:x + 6] - STEP
        assert np.nanmedian(np.abs(on_it)) < 1.0 and np.isfinite(on_it).mean() > 0.8
        assert np.isnan(flows[index][:, -6:]).mean() > 0.9


def test_without_movers_nothing_is_computed_between() -> None:
    found = both_ways(None, picture(1), picture(0), 60, 80, 0.7, boxes=np.zeros((0, 4), np.int64))  # type: ignore
    assert np.isnan(found).all()


def test_carried_moves_the_field_and_turns_its_vectors() -> None:
    turn = np.deg2rad(90.0)
    matrix = np.array([[np.cos(turn), -np.sin(turn), 79.0], [np.sin(turn), np.cos(turn), 0], [0, 0, 1]])
    shift = np.zeros((20, 20, 2), np.float32)
    shift[4:8, 10:16] = 3.0, 1.0
    shift[0, 0] = np.nan
    found = carried(shift, matrix, 80, 80)
    # (x, y) goes to (79 - y, x): rows become columns counted from the right, columns become rows
    expected = np.zeros_like(shift)
    expected[10:16, 12:16] = -1.0, 3.0
    np.testing.assert_allclose(found, expected, atol=1e-4)


def test_turned_round_leads_back() -> None:
    shift = np.zeros((10, 12, 2), np.float32)
    shift[2:5, 2:5] = 16.0, 8.0
    shift[9, 11] = 40.0, 0.0
    expected = np.zeros_like(shift)
    expected[4:7, 6:9] = -16.0, -8.0
    np.testing.assert_array_equal(turned_round(shift, 48, 40), expected)


@pytest.mark.parametrize('method', WARM_METHODS)
def test_a_first_guess_finds_what_the_method_alone_does_not(method: str) -> None:
    ground = smooth(WORLD)
    current, earlier = ground[:HEIGHT, 80:80 + WIDTH].copy(), ground[:HEIGHT, :WIDTH].copy()
    guess = np.full((60, 80, 2), (79.0, 1.0), np.float32)
    find = make_flow(OpticalFlowConfig(method=method))
    cold, warm = (both_ways(find, current, earlier, 60, 80, 0.7, start)[10:50, 10:50] for start in (None, guess))
    right = [(np.hypot(*np.moveaxis(flow - (80, 0), -1, 0)) < 0.5).mean() for flow in (cold, warm)]
    assert right[0] < 0.2 and right[1] > 0.9


def test_small_regions_leave_no_trace() -> None:
    current, earlier = picture(1), picture(0)
    dis = make_flow(OpticalFlowConfig())
    before = dis(current, earlier)
    flow_in_regions(dis, current, earlier, np.array([[280, 200, 320, 240]]))
    np.testing.assert_array_equal(dis(current, earlier), before)


def test_carried_is_finite_whatever_the_motion_is() -> None:
    """A first guess that is not would end the process inside OpenCV."""
    shift = np.full((20, 20, 2), 3.0, np.float32)
    with np.errstate(all='ignore'):
        for matrix in (np.diag([1.0, 1.0, 1e-300]), np.array([[1, 0, 0], [0, 1, 0], [1e30, 0, 1.0]])):
            assert np.isfinite(carried(shift, matrix, 80, 80)).all()


def test_warm_start_hands_on_the_last_flow(monkeypatch: pytest.MonkeyPatch) -> None:
    given = []

    def flow(one: np.ndarray, other: np.ndarray, start: np.ndarray | None = None) -> np.ndarray:
        given.append(start)
        return np.full((HEIGHT, WIDTH, 2), 2.0 if len(given) % 2 else -2.0, np.float32)

    monkeypatch.setattr(optical_flow, 'make_flow', lambda config: flow)
    monkeypatch.setattr(cv2, 'getNumThreads', lambda: 1)  # one way after the other
    run(OpticalFlowConfig(), 3)
    assert given == [None] * 4
    given.clear()
    run(OpticalFlowConfig(warm_start=True), 3)
    assert given[:2] == [None, None]
    # where the cell was in the picture before: GROUND leads 4 px right and 8 px up
    inside = np.s_[8:-16, 12:-8]
    np.testing.assert_allclose(given[2][inside], 2.0, atol=1e-4)
    np.testing.assert_allclose(given[3][inside], -2.0, atol=1e-4)


def test_warm_start_with_a_method_that_takes_no_guess_is_refused() -> None:
    for method in WARM_METHODS:
        OpticalFlowConfig(method=method, warm_start=True)
    with pytest.raises(ConfigError, match='optical_flow.warm_start: expected .* one of dis, .*, got deepflow'):
        OpticalFlowConfig(method='deepflow', warm_start=True)


def test_the_frame_of_a_carried_point_is_the_current_one() -> None:
    matrix = np.array([[1.02, 0.01, 3], [-0.01, 0.99, -2], [0, 0, 1]])
    points = grid_points(20, 30, 120, 80)
    shift = np.full((20, 30, 2), (1.5, -0.5), np.float32)
    found = carried(shift, matrix, 120, 80)[5:-5, 5:-5]
    linear = apply(matrix, points + shift) - apply(matrix, points)
    np.testing.assert_allclose(found, linear[5:-5, 5:-5], atol=1e-4)
