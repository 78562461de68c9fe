"""Fast small objects: rendered squares of known motion, before and after the search; what it costs and leaves alone."""

from __future__ import annotations

import time
from itertools import pairwise

import cv2
import numpy as np
import pytest

from motion_detect_ros.core.config import OpticalFlowConfig, PipelineConfig
from motion_detect_ros.core.flow_methods.forward_backward import forward_backward_flow
from motion_detect_ros.core.flow_methods.registry import make_flow
from motion_detect_ros.core.geometry.frame_history import FrameHistory
from motion_detect_ros.core.geometry.warp import stabilise
from motion_detect_ros.core.optical_flow.alternatives.block_matching import block_error, match_blocks, refine
from motion_detect_ros.core.optical_flow.alternatives.block_search import search_fast_movers, unexplained
from motion_detect_ros.core.optical_flow.stage import OpticalFlowStage
from motion_detect_ros.core.types import EgoMotion, EgoStatus, PreparedFrame
from motion_detect_ros.sources.synthetic import FlightConfig, SyntheticFlight

WIDTH, HEIGHT, CELL, PERIOD_NS = 480, 270, 4, 40_000_000
GROUND = np.array([3.3, -1.6])
SIZES, FAST, REACH = (12, 16, 24, 32, 48), (8, 16, 28, 40), 40


def texture(seed: int, width: int, height: int) -> np.ndarray:
    """Coarse and fine structure, smooth enough to be sampled between pixels."""
    random = np.random.default_rng(seed)
    layers = [weight * cv2.resize(random.normal(size=(height // s + 2, width // s + 2)).astype(np.float32),
                                  (width, height), interpolation=cv2.INTER_CUBIC)
              for s, weight in ((1, 2.0), (4, 1.0), (16, 1.0))]
    picture = cv2.GaussianBlur(sum(layers), (0, 0), 1.0)
    return 128 + 35 * (picture - picture.mean()) / picture.std()


def picture_of(size: int, position: np.ndarray, ground: np.ndarray, seed: int) -> np.ndarray:
    """A square with its top left corner at ``position`` over ground that is displaced by ``ground``; sensor noise."""
    shift = np.array([[1, 0, ground[0] - 60], [0, 1, ground[1] - 60]])
    image = cv2.warpAffine(texture(1, WIDTH + 120, HEIGHT + 120), shift, (WIDTH, HEIGHT), flags=cv2.INTER_LANCZOS4)
    place = np.array([[1, 0, position[0]], [0, 1, position[1]]])
    thing, cover = (cv2.warpAffine(each, place, (WIDTH, HEIGHT), flags=cv2.INTER_LINEAR)
                    for each in (texture(2, size, size), np.ones((size, size), np.float32)))
    noise = np.random.default_rng(seed).normal(0, 2, image.shape)
    return np.clip(cover * thing + (1 - cover) * image + noise, 0, 255).astype(np.uint8)


def flow_of_square(size: int, speed: float, search_px: int, direction: float = 0.5) -> tuple[np.ndarray, np.ndarray]:
    """Error of the stage's flow of every cell wholly on the square; and of every cell clear of it, pixels."""
    step = GROUND + speed * np.array([np.cos(direction), np.sin(direction)])
    start = np.array([210.3, 110.8]) - 0.5 * step
    config = OpticalFlowConfig(search_px=search_px)
    stage, history = OpticalFlowStage(PipelineConfig(optical_flow=config)), FrameHistory(config.baseline_s)
    matrix = np.array([[1, 0, GROUND[0]], [0, 1, GROUND[1]], [0, 0, 1]])
    for index in range(2):
        image = picture_of(size, start + index * step, index * GROUND, index)
        stamp, before = (index + 1) * PERIOD_NS, max(1, index) * PERIOD_NS
        status = EgoStatus.OK if index else EgoStatus.FIRST_FRAME
        frame = PreparedFrame(image, 1.0, WIDTH, HEIGHT, stamp)
        ego = EgoMotion(matrix if index else np.eye(3), np.eye(6), status, stamp, before)
        flow = stage.process(frame, ego, history.step(frame, ego)).flow
    left, top = start + step
    x, y = np.meshgrid(*(CELL * np.arange(count // CELL) for count in (WIDTH, HEIGHT)))
    inside = (x >= left) & (x + CELL <= left + size) & (y >= top) & (y + CELL <= top + size)
    near = (x > left - 60) & (x < left + size + 60) & (y > top - 60) & (y < top + size + 60)
    flow = flow[:inside.shape[0]]
    return np.hypot(*(flow[inside] - step).T), np.hypot(*(flow[~near] - GROUND).T)



def share_found(size: int, speeds: tuple[float, ...], search_px: int) -> float:
    """Share of the cells on the square whose flow is right to a pixel, over speeds and directions."""
    errors = [flow_of_square(size, speed, search_px, direction)[0] for speed in speeds for direction in (0.5, 1.6, 3.1)]
    return float((np.concatenate(errors) < 1).mean())


@pytest.mark.parametrize(('size', 'seen_without', 'seen_with'), [
    (12, 0.0, 0.5), (16, 0.0, 0.75), (24, 0.0, 0.85), (32, 0.05, 0.9), (48, 0.2, 0.85)])
def test_fast_squares_are_seen_by_the_search_only(size: int, seen_without: float, seen_with: float) -> None:
    assert share_found(size, FAST, 0) <= seen_without
    assert share_found(size, FAST, REACH) >= seen_with


@pytest.mark.parametrize('size', SIZES)
def test_nothing_but_the_square_is_touched(size: int) -> None:
    for speed in (1, 16):
        np.testing.assert_array_equal(flow_of_square(size, speed, REACH)[1], flow_of_square(size, speed, 0)[1])


def test_a_slow_square_is_left_to_the_flow_method() -> None:
    np.testing.assert_array_equal(flow_of_square(24, 1, REACH)[0], flow_of_square(24, 1, 0)[0])


def test_a_motion_beyond_the_radius_is_not_found() -> None:
    assert share_found(24, (28,), 16) == 0.0


def still_pair(seed: int = 5) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Two noisy pictures of the same ground, and its flow, zero, on the grid."""
    nowhere = np.array([-100.0, -100.0])
    current, earlier = (picture_of(12, nowhere, np.zeros(2), seed + index) for index in range(2))
    return current, earlier, np.zeros((HEIGHT // CELL, WIDTH // CELL, 2), np.float32)


def test_still_noise_is_left_alone() -> None:
    current, earlier, flow = still_pair()
    assert search_fast_movers(flow, current, earlier, REACH) is flow


def test_what_appears_from_nowhere_is_not_matched() -> None:
    current, earlier, flow = still_pair()
    current[100:132, 200:232] = texture(3, 32, 32).clip(0, 255)
    np.testing.assert_array_equal(search_fast_movers(flow, current, earlier, REACH), flow)


def test_a_pattern_that_repeats_is_not_matched() -> None:
    current, earlier, flow = still_pair()
    waves = (128 + 60 * np.sin(2 * np.pi * np.add.outer(np.arange(32), np.arange(32)) / 8)).astype(np.uint8)
    earlier[100:132, 200:232], current[100:132, 221:253] = waves, waves
    np.testing.assert_array_equal(search_fast_movers(flow, current, earlier, REACH), flow)


def test_a_flight_without_movers_has_no_takes() -> None:
    flight = SyntheticFlight(FlightConfig(width=WIDTH, height=HEIGHT, focal_px=360.0, frames=12, cars=0, people=0))
    find = make_flow(OpticalFlowConfig())
    frames = [(cv2.cvtColor(frame.image, cv2.COLOR_BGR2GRAY), frame.ground_homography) for frame in flight]
    cells = takes = 0
    for (before, _), (current, matrix) in pairwise(frames):
        earlier = stabilise(before, matrix)
        flow = forward_backward_flow(find, current, earlier, HEIGHT // CELL, WIDTH // CELL, 0.7)
        found = search_fast_movers(flow, current, earlier, REACH)
        takes += np.count_nonzero((found != flow) & np.isfinite(found))
        cells += flow[..., 0].size
    assert takes < 1e-4 * cells


def test_it_costs_little_where_nothing_is_fast() -> None:
    random = np.random.default_rng(6)
    ground = texture(7, 960, 540)
    current, earlier = (np.clip(ground + random.normal(0, 2, ground.shape), 0, 255).astype(np.uint8) for _ in range(2))
    flow = np.zeros((135, 240, 2), np.float32)
    times = []
    for _ in range(20):
        start = time.perf_counter()
        assert search_fast_movers(flow, current, earlier, REACH) is flow
        times.append(time.perf_counter() - start)
    assert min(times) < 2e-3


def test_half_a_pixel_of_misplacement_is_no_change_but_a_new_thing_is() -> None:
    ground = cv2.GaussianBlur(texture(8, WIDTH, HEIGHT), (0, 0), 1.5)
    earlier = cv2.warpAffine(ground, np.array([[1, 0, 0.5], [0, 1, 0]]), (WIDTH, HEIGHT), flags=cv2.INTER_CUBIC)
    current, earlier = (each.clip(0, 255).astype(np.uint8) for each in (ground, earlier))
    current[100:120, 100:120] = 255
    change = unexplained(current, earlier, HEIGHT // CELL, WIDTH // CELL)
    assert change[26:29, 26:29].min() > 30
    change[24:31, 24:31] = 0
    assert change[:, 2:-2].max() < 1


def test_block_error_by_hand() -> None:
    current = np.full((9, 9), 10, np.uint8)
    earlier = np.tile(np.arange(0, 90, 10, dtype=np.uint8), (9, 1))
    # the block's columns 3 to 5 are compared with 35, 45, 55
    assert block_error(current, earlier, 4, 4, 0.5, 0.0, 1) == pytest.approx(35.0)
    assert block_error(current, earlier, 4, 4, 4.0, 0.0, 1) == np.inf


def test_refine_finds_a_part_of_a_pixel() -> None:
    ground = cv2.GaussianBlur(texture(9, 80, 80), (0, 0), 1.5)
    moved = cv2.warpAffine(ground, np.array([[1, 0, 6.3], [0, 1, -3.6]]), (80, 80), flags=cv2.INTER_LANCZOS4)
    current, earlier = (each.clip(0, 255).astype(np.uint8) for each in (ground, moved))
    np.testing.assert_allclose(refine(current, earlier, 40, 40, 5, -3, 5, 2), (6.3, -3.6), atol=0.12)


def test_blocks_match_only_where_they_may() -> None:
    earlier = texture(10, 100, 100).clip(0, 255).astype(np.uint8)
    current = np.roll(earlier, (-5, 9), (0, 1))
    everywhere, nowhere = np.ones_like(current), np.zeros_like(current)
    centres, worst = np.array([[50, 50]]), np.array([8.0], np.float32)
    motions, good = match_blocks(current, earlier, everywhere, everywhere, centres, worst, 3, 12, 1.1)
    assert motions.tolist() == [[-9, 5]] and good.all()
    for here, there, least, reach in (
            (everywhere, nowhere, worst, 12), (nowhere, everywhere, worst, 12), (everywhere, everywhere, worst, 8),
            (everywhere, everywhere, -worst, 12)):
        assert not match_blocks(current, earlier, here, there, centres, least, 3, reach, 1.1)[1].any()
