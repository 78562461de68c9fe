"""Flow in regions only: against hand-made fields, and on a rendered square."""

from __future__ import annotations

import cv2
import numpy as np

from motion_detect_ros.core.config import OpticalFlowConfig, PipelineConfig
from motion_detect_ros.core.flow_methods.registry import make_flow
from motion_detect_ros.core.geometry.frame_history import FrameHistory
from motion_detect_ros.core.geometry.warp import apply, grid_points
from motion_detect_ros.core.optical_flow.alternatives.regions import (
    carried_flow,
    confined,
    flow_in_regions,
    moving_cells,
    regions_around,
)
from motion_detect_ros.core.optical_flow.stage import OpticalFlowStage
from motion_detect_ros.core.types import EgoMotion, EgoStatus, PreparedFrame

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
    stage, history = OpticalFlowStage(PipelineConfig(optical_flow=config)), FrameHistory(config.baseline_s)
    flows = []
    for index in range(frames):
        status = EgoStatus.OK if index else EgoStatus.FIRST_FRAME
        stamp = (index + 1) * PERIOD_NS
        ego = EgoMotion(GROUND if index else np.eye(3), np.eye(6), status, stamp, max(stamp - PERIOD_NS, PERIOD_NS))
        frame = PreparedFrame(picture(index), 1.0, WIDTH, HEIGHT, stamp)
        flows.append(stage.process(frame, ego, history.step(frame, ego)).flow)
    return flows


def test_inside_its_regions_it_is_the_method_on_the_cut_and_nan_elsewhere() -> None:
    current, earlier = picture(1), picture(0)
    dis = make_flow(OpticalFlowConfig())
    found = flow_in_regions(dis, np.array([[40, 60, 140, 160], [300, 0, 320, 40]]), current, earlier)
    np.testing.assert_array_equal(
        found[60:160, 40:140], dis(current[44:176, 24:156].copy(), earlier[44:176, 24:156].copy())[16:-16, 16:-16])
    assert np.isfinite(found[:40, 300:]).all()
    found[60:160, 40:140], found[:40, 300:] = np.nan, np.nan
    assert np.isnan(found).all()


def test_a_region_of_everything_is_the_whole_flow() -> None:
    current, earlier = picture(1), picture(0)
    dis = make_flow(OpticalFlowConfig())
    np.testing.assert_array_equal(
        flow_in_regions(dis, np.array([[0, 0, WIDTH, HEIGHT]]), current, earlier), dis(current, earlier))


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
    found = confined(None, np.zeros((0, 4), np.int64))(picture(1), picture(0))  # type: ignore[arg-type]
    assert np.isnan(found).all() and found.shape == (HEIGHT, WIDTH, 2)


def test_carried_moves_the_field_and_turns_its_vectors() -> None:
    turn = np.deg2rad(90.0)
    matrix = np.array([[np.cos(turn), -np.sin(turn), 79.0], [np.sin(turn), np.cos(turn), 0], [0, 0, 1]])
    shift = np.zeros((20, 20, 2), np.float32)
    shift[4:8, 10:16] = 3.0, 1.0
    shift[0, 0] = np.nan
    found = carried_flow(shift, matrix, 80, 80)
    # (x, y) goes to (79 - y, x): rows become columns counted from the right, columns become rows
    expected = np.zeros_like(shift)
    expected[10:16, 12:16] = -1.0, 3.0
    np.testing.assert_allclose(found, expected, atol=1e-4)


def test_small_regions_leave_no_trace() -> None:
    current, earlier = picture(1), picture(0)
    dis = make_flow(OpticalFlowConfig())
    before = dis(current, earlier)
    flow_in_regions(dis, np.array([[280, 200, 320, 240]]), current, earlier)
    np.testing.assert_array_equal(dis(current, earlier), before)


def test_carried_is_finite_whatever_the_motion_is() -> None:
    shift = np.full((20, 20, 2), 3.0, np.float32)
    with np.errstate(all='ignore'):
        for matrix in (np.diag([1.0, 1.0, 1e-300]), np.array([[1, 0, 0], [0, 1, 0], [1e30, 0, 1.0]])):
            assert np.isfinite(carried_flow(shift, matrix, 80, 80)).all()


def test_the_frame_of_a_carried_point_is_the_current_one() -> None:
    matrix = np.array([[1.02, 0.01, 3], [-0.01, 0.99, -2], [0, 0, 1]])
    points = grid_points(20, 30, 120, 80)
    shift = np.full((20, 30, 2), (1.5, -0.5), np.float32)
    found = carried_flow(shift, matrix, 120, 80)[5:-5, 5:-5]
    linear = apply(matrix, points + shift) - apply(matrix, points)
    np.testing.assert_allclose(found, linear[5:-5, 5:-5], atol=1e-4)
