"""Warps, chains of motions, corners, background, segments, boxes: small geometry by hand."""

from __future__ import annotations

import math

import cv2
import numpy as np
import pytest
from joined_patches import joined_patches
from scipy import ndimage

from motion_detect_ros.core.background.planar import fit_background
from motion_detect_ros.core.config import BackgroundConfig
from motion_detect_ros.core.detection.patches import Patch, connected_pixels
from motion_detect_ros.core.detection.segments import connected_segments
from motion_detect_ros.core.geometry.boxes import Box
from motion_detect_ros.core.geometry.carried import carried, length_scale
from motion_detect_ros.core.geometry.motion_chain import MotionChain
from motion_detect_ros.core.geometry.warp import apply, at_scale, grid_points, points_at_scale, stabilise
from motion_detect_ros.core.types import EgoMotion, EgoStatus

SECOND = 1_000_000_000


def shift(dx: float, dy: float) -> np.ndarray:
    return np.array([[1, 0, dx], [0, 1, dy], [0, 0, 1]], float)


def ego(previous_s: float, now_s: float, matrix: np.ndarray, status: EgoStatus = EgoStatus.OK) -> EgoMotion:
    return EgoMotion(matrix, np.eye(6), status, round(now_s * SECOND), round(previous_s * SECOND))


class TestWarp:
    def test_points_keep_their_place_at_another_scale(self):
        """A pixel at half the size is two by two: the first one's centre is between the first two."""
        points = np.array([[0.5, 2.5], [10.0, 0.0]], np.float32)
        half = points_at_scale(points, 0.5)
        assert half.dtype == np.float32
        assert half.tolist() == [[0.0, 1.0], [4.75, -0.25]]
        assert points_at_scale(half, 2.0).tolist() == points.tolist()

    def test_half_resolution(self):
        # full: x -> x + 10. Pixel 3.5 (between 3 and 4) of the full image is pixel 1.5 of the half; 13.5 is 6.5.
        half = at_scale(shift(10, 4), 0.5)
        np.testing.assert_allclose(half @ [1.5, 1.5, 1], [6.5, 3.5, 1])

    @pytest.mark.parametrize('size', [1.0, 2.0])
    @pytest.mark.parametrize('perspective', [0.0, 2e-4])
    def test_a_picture_goes_where_its_points_do(self, perspective: float, size: float):
        """Also by a matrix that is a multiple of itself; beyond its border it goes on as it ends."""
        def pattern(x: np.ndarray, y: np.ndarray) -> np.ndarray:
            return 120 + 50 * np.sin(x / 9) + 40 * np.cos(y / 7)
        matrix = np.array([[1.02, 0.03, -7.3], [-0.02, 0.98, 5.6], [perspective, -perspective, 1.0]])
        x, y = np.meshgrid(np.arange(160.0), np.arange(90.0))
        before = np.moveaxis(np.stack([x, y, np.ones_like(x)], -1) @ np.linalg.inv(matrix).T, -1, 0)
        expected = pattern(np.clip(before[0] / before[2], 0, 159), np.clip(before[1] / before[2], 0, 89))
        warped = stabilise(np.rint(pattern(x, y)).astype(np.uint8), size * matrix)
        assert np.abs(warped - expected).max() < 2.5

    def test_perspective_division(self):
        matrix = np.array([[1, 0, 0], [0, 1, 0], [0.01, 0, 1]])
        # (100, 50): divided by 1 + 1 = 2
        np.testing.assert_allclose(apply(matrix, np.float32([[100, 50]])), [[50, 25]])

    @pytest.mark.parametrize('kind', [np.float32, np.float64])
    def test_points_of_any_shape_and_kind_go_through_a_warp(self, kind):
        random = np.random.default_rng(0)
        points, matrix = random.uniform(0, 500, (7, 30, 2)).astype(kind), np.eye(3) + random.normal(0, 1e-4, (3, 3))
        seen = np.concatenate([points, np.ones((7, 30, 1))], axis=-1) @ matrix.T
        for chosen in (points, points[::2, ::3]):
            moved = apply(matrix, chosen)
            assert moved.dtype == kind
            expected = seen if chosen is points else seen[::2, ::3]
            np.testing.assert_allclose(moved, expected[..., :2] / expected[..., 2:], rtol=2e-5, atol=1e-3)

    def test_grid_points_are_centres_of_cells(self):
        # 8 pixels in 2 cells: pixels 0..3 and 4..7, centres 1.5 and 5.5
        np.testing.assert_allclose(grid_points(1, 2, 8, 4)[0], [[1.5, 1.5], [5.5, 1.5]])


class TestCarried:
    WARP = np.array([[1.1, 0.02, 3.0], [-0.01, 0.9, -2.0], [5e-4, 1e-3, 1.0]])

    def test_through_the_warp_in_centres_of_pixels_then_on_at_its_own_velocity(self):
        # centre of pixel (100, 200): 117 and 177 over a depth of 1 + 0.05 + 0.2; the speed by the derivative there
        place, speed = carried(self.WARP.tolist(), (100.5, 200.5), (10.0, 20.0), 0.1)
        np.testing.assert_allclose(speed, [(117.0 + 11.4 * 1e-6) / (1.25 + 0.025e-6) * 1e6 - 93.6e6,
                                           (177.0 + 17.9 * 1e-6) / (1.25 + 0.025e-6) * 1e6 - 141.6e6], rtol=1e-6)
        np.testing.assert_allclose(place, [93.6 + 0.5 + 0.1 * speed[0], 141.6 + 0.5 + 0.1 * speed[1]])

    @pytest.mark.parametrize('perspective', [(0.0, 0.0), (5e-4, 1e-3), (-4e-4, 7e-4)])
    @pytest.mark.parametrize('place', [(0.0, 0.0), (100.0, 200.0), (640.0, 30.0)])
    def test_speeds_and_sizes_change_as_a_small_square_at_the_place_does(self, place, perspective):
        matrix = self.WARP.copy()
        matrix[2, :2] = perspective
        square = np.array(place) + 0.01 * np.array([(0, 0), (1, 0), (1, 1), (0, 1)])
        there = cv2.perspectiveTransform(square[None], matrix)[0]
        centre = (place[0] + 0.5, place[1] + 0.5)
        area = cv2.contourArea((there - there[0]).astype(np.float32)) / 1e-4
        assert length_scale(matrix.tolist(), centre) == pytest.approx(math.sqrt(area), rel=1e-3)
        _, speed = carried(matrix.tolist(), centre, (10.0, 0.0), 0.1)
        np.testing.assert_allclose(speed, 1e3 * (there[1] - there[0]), rtol=1e-3, atol=1e-3)

    @pytest.mark.parametrize('perspective', [(1e-3, 0.0), (0.0, 1e-3), (-4e-4, 7e-4)])
    def test_places_are_those_of_opencv(self, perspective):
        matrix = self.WARP.copy()
        matrix[2, :2] = perspective
        place, _ = carried(matrix.tolist(), (100.5, 200.5), (0.0, 0.0), 0.1)
        there = cv2.perspectiveTransform(np.array([[[100.0, 200.0]]]), matrix)[0, 0]
        np.testing.assert_allclose(place, there + 0.5)


class TestMotionChain:
    def test_composes_backwards(self):
        chain = MotionChain()
        chain.append(ego(0, 1, shift(5, 0)))
        chain.append(ego(1, 2, np.diag([2.0, 2.0, 1.0])))
        back = chain.nearest(2.0)
        # (1, 1) two frames ago: + (5, 0) = (6, 1), doubled = (12, 2)
        assert back.stamp_ns == 0
        np.testing.assert_allclose(back.matrix @ [1, 1, 1], [12, 2, 1])

    @pytest.mark.parametrize(('seconds', 'frames'), [(0.01, 1), (0.2, 2), (0.26, 3), (9.0, 4)])
    def test_nearest_in_time(self, seconds, frames):
        chain = MotionChain()
        for index in range(4):
            chain.append(ego(index / 10, (index + 1) / 10, np.eye(3)))
        assert chain.nearest(seconds).stamp_ns == round((4 - frames) / 10 * SECOND)

    def test_broken_by_a_missing_or_failed_link(self):
        chain = MotionChain()
        chain.append(ego(0, 1, shift(1, 0)))
        chain.append(ego(2, 3, shift(1, 0)))
        assert [back.stamp_ns for back in chain.chained()] == [2 * SECOND]
        chain.append(ego(3, 4, np.eye(3), EgoStatus.LOW_TEXTURE))
        assert chain.nearest(1.0) is None

    def test_bounded(self):
        chain = MotionChain()
        lengths = []
        for index in range(2000):
            chain.append(ego(index, index + 1, np.eye(3)))
            lengths.append(len(chain.chained()))
        assert lengths[:10] == list(range(1, 11)), 'nothing is forgotten at once'
        assert len(set(lengths[100:])) == 1, 'nor kept for ever'


class TestBackground:
    def test_quadratic_field_under_outliers(self):
        random = np.random.default_rng(1)
        y, x = np.mgrid[0:60, 0:100].astype(np.float32)
        true = np.stack([0.5 + 0.01 * x - 2e-4 * x * y, 1e-4 * x * x - 0.02 * y], axis=-1)
        noisy = true + random.normal(0, 0.5, true.shape).astype(np.float32)
        noisy[:30, :60] += 9.0  # 30 %
        noisy[40, 40] = np.nan
        found = fit_background(noisy, BackgroundConfig(noise_floor_px=0.01, noise_share=0.0), np.zeros((60, 100)))
        error = np.abs(found.flow - true).max(axis=-1)
        assert error[30:].max() < 0.15 and error[:30, 60:].max() < 0.15
        # Behind the outliers the surface is extrapolated: 0.15 px are one deviation of a fit to every second true cell.
        assert error.max() < 0.6
        assert found.sigma_px[0, 0] == pytest.approx(0.5, rel=0.35)  # the median counts the outliers in: 0.62

    def test_nothing_known_means_infinitely_noisy(self):
        found = fit_background(np.full((10, 10, 2), np.nan, np.float32), BackgroundConfig(), np.zeros((10, 10)))
        assert np.isinf(found.sigma_px).all() and not found.flow.any()

    def test_share_of_the_camera_flow_is_added(self):
        flat, far = np.zeros((10, 10, 2), np.float32), np.full((10, 10), 50.0, np.float32)
        found = fit_background(flat, BackgroundConfig(noise_floor_px=0.3, noise_share=0.02), far)
        np.testing.assert_allclose(found.sigma_px, 0.3 + 1.0)


class TestSegments:
    def test_same_components_as_scipy(self):
        random = np.random.default_rng(3)
        labels = (random.random((40, 60)) < 0.45).astype(np.int32)
        segments = connected_segments(labels, np.float32([[0, 0], [9, 0]]), 0.5)
        expected, count = ndimage.label(labels, structure=np.ones((3, 3)))
        assert len(segments) == count
        for segment in segments:
            r, c = np.nonzero(expected == expected[segment.rows[0], segment.columns[0]])
            assert (segment.rows.tolist(), segment.columns.tolist()) == (r.tolist(), c.tolist())
            assert segment.box == Box(c.min(), r.min(), c.max() + 1, r.max() + 1)

    def test_the_neuron_of_a_segment_is_the_one_with_most_cells(self):
        labels = np.zeros((6, 9), np.int32)
        labels[0, :5], labels[1, :3] = 1, 3
        labels[4, :2], labels[5, 1:3] = 3, 2
        alike = np.float32([[0, 0], [9, 0], [9, 1], [9, 2]])
        assert [segment.neuron for segment in connected_segments(labels, alike, 0.5)] == [1, 2]

    def test_touching_motions_join_only_where_they_match(self):
        labels = np.zeros((4, 6), np.int32)
        labels[:, :3], labels[:, 3:] = 1, 2
        same, other = np.float32([[0, 0], [9, 0], [10, 0]]), np.float32([[0, 0], [9, 0], [-9, 0]])
        assert len(connected_segments(labels, same, 0.5)) == 1
        assert [len(s.rows) for s in connected_segments(labels, other, 0.5)] == [12, 12]

    def test_background_and_unknown_cells_are_nobodys(self):
        labels = np.array([[0, -1, 1]], np.int32)
        (segment,) = connected_segments(labels, np.float32([[0, 0], [5, 5]]), 0.5)
        assert (segment.rows.tolist(), segment.columns.tolist(), segment.neuron) == ([0], [2], 1)


class TestBoxes:
    def test_numbers(self):
        box = Box(2, 3, 12, 8)
        assert (box.width, box.height, box.area) == (10, 5, 50)
        assert box.grown(4, 13, 100) == Box(0, 0, 13, 12)
        assert box.union(Box(20, 0, 22, 4)) == Box(2, 0, 22, 8)
        assert box.edges == (2, 3, 12, 8)

    def test_patches_close_small_gaps_only(self):
        mask = np.zeros((30, 60), bool)
        mask[10:20, 5:15] = mask[10:20, 18:28] = mask[10:20, 45:55] = True
        count, labels = connected_pixels(mask, 7)
        groups = [np.nonzero(mask & (labels == number))[1] for number in range(1, count)]
        assert sorted((g.min(), g.max() + 1, len(g)) for g in groups) == [(5, 28, 200), (45, 55, 100)]

    @pytest.mark.parametrize('closing_px', range(1, 12))
    def test_closing_loses_no_pixel_and_joins_nothing_farther_than_its_size(self, closing_px):
        mask = np.zeros((40, 80), bool)
        mask[10:20, 5:15] = mask[10:20, 45:55] = True
        count, labels = connected_pixels(mask, closing_px)
        assert count == 3
        assert [set(np.unique(labels[10:20, left:left + 10])) for left in (5, 45)] in ([{1}, {2}], [{2}, {1}])

    def test_joining_depends_on_the_smaller_patch(self):
        big, near, far = Patch(Box(0, 0, 40, 40), 900), Patch(Box(44, 0, 64, 20), 300), Patch(Box(90, 0, 100, 10), 80)
        # gap 4 <= 0.4 * 20; gap from the union at 64 to 90 is 26 > 0.4 * 10
        joined = joined_patches([big, near, far])
        assert sorted((p.box.left, p.box.right, p.pixels) for p in joined) == [(0, 64, 1200), (90, 100, 80)]

    @pytest.mark.parametrize(('beside', 'below', 'one'), [(8, 0, True), (9, 0, False), (0, 8, True), (6, 6, False)])
    def test_parts_are_joined_where_their_common_box_is_hardly_larger(self, beside, below, one):
        """Two of 20 x 20 pixels, whose gap may be 8, in a box of at most 1040."""
        left, top = 20 + beside if beside else 0, 20 + below if below else 0
        parts = [Patch(Box(0, 0, 20, 20), 50), Patch(Box(left, top, left + 20, top + 20), 60)]
        assert len(joined_patches(parts)) == (1 if one else 2)

    def test_a_third_part_joins_two_that_it_lies_between(self):
        ends = [Patch(Box(0, 0, 20, 20), 50), Patch(Box(40, 0, 60, 20), 60)]
        assert len(joined_patches(ends)) == 2
        between = Patch(Box(20, 0, 40, 20), 70)
        for parts in ([*ends, between], [between, *ends], [ends[0], between, ends[1]]):
            assert joined_patches(parts) == [Patch(Box(0, 0, 60, 20), 180)]
