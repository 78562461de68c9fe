"""Parts of the fit of boxes to clusters of points, against the same in NumPy and OpenCV, written here."""

from __future__ import annotations

import cv2
import numpy as np
import pytest

from motion_detect_ros.core.config import ObjectsConfig
from motion_detect_ros.core.detection.photometric import PhotometricTest
from motion_detect_ros.core.geometry.boxes import Box
from motion_detect_ros.core.trajectories.clusters import Cluster
from motion_detect_ros.core.trajectories.own_pixels import NearestPoints
from motion_detect_ros.core.trajectories.point_boxes import BoxFitter
from motion_detect_ros.core.trajectories.points import Points
from motion_detect_ros.core.trajectories.recent_frames import RecentFrames
from motion_detect_ros.core.trajectories.soft_shadows import BRIGHT, FAINT, SoftShadows
from motion_detect_ros.core.trajectories.strong_pixels import outlines, strong_pixels
from motion_detect_ros.core.types import EgoMotion, EgoStatus, PreparedFrame

REGION = Box(200, 100, 360, 220)
PERIOD_NS, FRAMES = 40_000_000, 8
STEP = np.array([[1.002, -0.003, 1.7], [0.003, 0.999, -0.6], [1e-6, -2e-6, 1.0]])


def bounds(mask: np.ndarray) -> list[int]:
    y, x = np.nonzero(mask)
    return [x.min(), y.min(), x.max() + 1, y.max() + 1]


def foreground(seed: int, threshold: float) -> PhotometricTest:
    random = np.random.default_rng(seed)
    mask = cv2.GaussianBlur(random.normal(0.0, 1.0, (REGION.height, REGION.width)), (0, 0), 3.0) > threshold
    return PhotometricTest(mask, random.exponential(20.0, mask.shape).astype(np.float32))


def places_in(region: Box, seed: int, count: int) -> np.ndarray:
    return np.random.default_rng(seed).uniform(
        [region.left, region.top], [region.right - 1, region.bottom - 1], (count, 2)).astype(np.float32)


class TestStrongPixels:
    @pytest.mark.parametrize('seed', range(4))
    def test_are_near_the_peak_of_the_components_at_or_beside_the_places(self, seed: int) -> None:
        test, config, places = foreground(seed, 0.07), ObjectsConfig(), places_in(REGION, seed + 10, 6)
        kernel = cv2.getStructuringElement(cv2.MORPH_ELLIPSE, (config.closing_px, config.closing_px))
        _, labels = cv2.connectedComponents(cv2.morphologyEx(test.foreground.astype(np.uint8), cv2.MORPH_CLOSE, kernel))
        near = np.zeros(labels.shape, np.uint8)
        columns, rows = np.rint(places).astype(int).T
        near[rows - REGION.top, columns - REGION.left] = 1
        own = np.setdiff1d(labels[cv2.dilate(near, np.ones((3, 3), np.uint8)) > 0], [0])
        pixels = test.foreground & np.isin(labels, own)
        expected = pixels & (test.gain > config.peak_share * np.percentile(test.gain[pixels], 90.0))
        assert 6 <= expected.sum() < pixels.sum() < test.foreground.sum()
        found = strong_pixels(test, places, REGION, config)
        assert found is not None
        np.testing.assert_array_equal(found, expected)

    def test_are_none_where_no_component_is_near(self) -> None:
        test = foreground(1, 0.07)
        test.foreground[:20, :20] = False
        corner = np.float32([[REGION.left + 5, REGION.top + 5]])
        assert strong_pixels(test, corner, REGION, ObjectsConfig()) is None

    @pytest.mark.parametrize(('side', 'found'), [(2, False), (3, True)])
    def test_are_none_where_they_are_noise(self, side: int, found: bool) -> None:
        mask = np.zeros((REGION.height, REGION.width), bool)
        mask[30:30 + side, 40:40 + side] = True
        test = PhotometricTest(mask, np.full(mask.shape, 50.0, np.float32))
        place = np.float32([[REGION.left + 39, REGION.top + 29]])  # beside its corner
        assert (strong_pixels(test, place, REGION, ObjectsConfig()) is not None) == found


class TestOutlines:
    @pytest.mark.parametrize('seed', range(3))
    def test_are_those_of_numpy(self, seed: int) -> None:
        strong, shadow = (foreground(seed + add, 0.05).foreground for add in (0, 20))
        places = places_in(REGION, seed, 40)
        columns, rows = np.rint(places).astype(int).T
        free = places[~shadow[rows - REGION.top, columns - REGION.left]]
        assert 3 < len(free) < 40
        whole, solid = outlines(strong, shadow, places, REGION)
        assert solid is not None
        for found, pixels, points in ((whole, strong, places), (solid, strong & ~shadow, free)):
            assert (found.bounds, found.number) == (bounds(pixels), pixels.sum())
            np.testing.assert_array_equal([found.low, found.high], [points.min(axis=0), points.max(axis=0)])

    @pytest.mark.parametrize(('pixels', 'points', 'enough'), [(6, 3, True), (5, 3, False), (6, 2, False)])
    def test_leave_out_a_shadow_with_enough_beside_it(self, pixels: int, points: int, enough: bool) -> None:
        strong, shadow = np.ones((1, 20), bool), np.ones((1, 20), bool)
        shadow[0, :pixels] = False
        region = Box(7, 3, 27, 4)
        places = np.float32([[7 + n, 3] for n in range(points)] + [[20 + n, 3] for n in range(4)])
        whole, solid = outlines(strong, shadow, places, region)
        assert whole.bounds == [0, 0, 20, 1]
        assert (solid is not None) == enough


@pytest.mark.parametrize(('old_share', 'measured'), [(1.0, True), (0.5, True), (0.2, False)])
def test_motion_is_the_median_of_the_points_old_enough(old_share: float, measured: bool) -> None:
    """Beyond the ego-motion; from the cluster's velocity where too few are old enough."""
    random, frames, ago, count = np.random.default_rng(3), RecentFrames(), 4, 31
    for index in range(FRAMES):
        status, stamp_ns = EgoStatus.OK if index else EgoStatus.FIRST_FRAME, (index + 1) * PERIOD_NS
        frames.add(PreparedFrame(np.zeros((40, 60), np.uint8), 1.0, 60, 40, stamp_ns),
                   EgoMotion(STEP, np.eye(6), status, stamp_ns, stamp_ns - PERIOD_NS))
    path = random.uniform(5.0, 50.0, (80, FRAMES, 2)).astype(np.float32)
    members = random.permutation(80)[:count]
    age = np.full(80, 2, np.int32)
    old = members[:round(old_share * count)]
    age[old] = random.integers(ago, FRAMES, len(old))
    points = Points(path, age, np.zeros((80, 2), np.float32), np.arange(80))
    cluster = Cluster(members, path[members, 0].min(axis=0), path[members, 0].max(axis=0), np.array([30.0, -20.0]),
                      np.array([2.0, 5.0]))
    fitter = BoxFitter(points, frames, None, NearestPoints(points.now, np.zeros(80, int)), SoftShadows(frames),
                       ObjectsConfig())
    background, motion = fitter._motions(cluster, ago)
    before = np.concatenate([path[old, ago].astype(float), np.ones((len(old), 1))], axis=1)
    carried = before @ np.linalg.matrix_power(STEP, ago).T
    median = np.median(path[old, 0] - carried[:, :2] / carried[:, 2:], axis=0)
    expected = median if measured else [32 * 0.16, -15 * 0.16]
    np.testing.assert_allclose(motion, expected, atol=1e-4)
    np.testing.assert_allclose(background, [2 * 0.16, 5 * 0.16], rtol=1e-6)


@pytest.mark.parametrize('corner', [(40, 30), (41, 31), (0, 0)])
def test_soft_shadow_is_where_the_ground_shows_through_beyond_the_body(corner: tuple[int, int]) -> None:
    random = np.random.default_rng(4)
    faint = cv2.GaussianBlur(random.normal(0.0, 1.0, (70, 90)), (0, 0), 3.0) > -0.05
    shadows = SoftShadows.__new__(SoftShadows)
    shadows.__dict__.update(_seconds=1.0, tones=np.where(faint, FAINT, BRIGHT))
    region = Box(corner[0], corner[1], corner[0] + 77, corner[1] + 63)
    own = cv2.GaussianBlur(random.normal(0.0, 1.0, (63, 77)), (0, 0), 4.0) > 0.0
    there = np.kron(faint, np.ones((2, 2), bool))[region.top:region.bottom, region.left:region.right]
    expected = there & (cv2.dilate((own & ~there).astype(np.uint8), np.ones((5, 5), np.uint8)) == 0)
    assert 0.3 <= (own & ~expected).sum() / own.sum() < 0.9
    np.testing.assert_array_equal(shadows.of(own, region, 100.0, 50.0), expected)
    assert not shadows.of(own, region, 53.9, 50.0).any()
