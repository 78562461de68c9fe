"""Points that can be spared, and where new ones start first."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from scipy.spatial import cKDTree

from motion_detect_ros.core.geometry.cells import near_others
from motion_detect_ros.core.trajectories import new_points
from motion_detect_ros.core.trajectories.new_points import NewPoints
from motion_detect_ros.core.trajectories.object_motion import PointMotion
from motion_detect_ros.core.trajectories.points import Points, PointTracker
from motion_detect_ros.core.trajectories.recent_frames import MAX_FRAMES, RecentFrames
from motion_detect_ros.core.trajectories.spare_points import spare_points
from motion_detect_ros.core.types import EgoMotion, EgoStatus, PreparedFrame

PERIOD_NS = 40_000_000
WIDTH, HEIGHT = 320, 160
#: Every 4 pixels: 16 points in each cell of 16 pixels.
LATTICE = np.stack(np.meshgrid(np.arange(2.0, WIDTH, 4.0), np.arange(2.0, HEIGHT, 4.0)), axis=-1).reshape(-1, 2)
MOVER = np.array([[162.0, 82.0]])


def noise(seed: int) -> np.ndarray:
    return np.random.default_rng(seed).integers(0, 256, (HEIGHT, WIDTH), np.uint8)


def recent(count: int = 26) -> RecentFrames:
    """Pictures that differ everywhere, of a camera that stands."""
    frames = RecentFrames()
    for index in range(count):
        prepared = PreparedFrame(noise(index), 1.0, WIDTH, HEIGHT, (index + 1) * PERIOD_NS)
        status = EgoStatus.OK if index else EgoStatus.FIRST_FRAME
        frames.add(prepared, EgoMotion(np.eye(3), np.eye(6), status, (index + 1) * PERIOD_NS, index * PERIOD_NS))
    return frames


def lattice(age: int = 20) -> Points:
    path = np.full((len(LATTICE), MAX_FRAMES, 2), np.nan, np.float32)
    path[:, 0] = LATTICE
    return Points(path, np.full(len(LATTICE), age, np.int32), np.zeros((len(LATTICE), 2), np.float32),
                  np.arange(len(LATTICE), dtype=np.int64))


def motion(moving: np.ndarray | None = None, evidence: float = 0.0) -> PointMotion:
    sigmas = np.zeros(len(LATTICE)) if moving is None else np.where(moving, 9.0, 0.0)
    return replace(PointMotion.at_rest(len(LATTICE)), sigmas=sigmas, evidence=np.maximum(sigmas, evidence))


def test_of_points_that_stand_still_one_a_cell_stays():
    spare = spare_points(lattice(), motion(), recent())
    columns, rows = (LATTICE[~spare] // 16).astype(int).T
    assert sorted(zip(columns, rows, strict=True)) == [
        (column, row) for column in range(WIDTH // 16) for row in range(HEIGHT // 16)]


def test_the_oldest_one_stays():
    points = lattice()
    points.age[1] = 24
    spare = spare_points(points, motion(), recent())
    first_cell = (LATTICE < 16).all(axis=1)
    assert np.flatnonzero(first_cell & ~spare).tolist() == [1]


def test_none_is_spared_near_what_moves():
    moving = (LATTICE == MOVER).all(axis=1)
    spare = spare_points(lattice(), motion(moving), recent())
    near = np.linalg.norm(LATTICE - MOVER, axis=1) < 29.0
    far = np.linalg.norm(LATTICE - MOVER, axis=1) > 31.0
    assert moving.sum() == 1
    assert not spare[near].any()
    assert spare[far].mean() > 0.9


def test_near_is_what_a_tree_of_all_points_finds():
    random = np.random.default_rng(4)
    points = (random.random((2000, 2)) * [WIDTH, HEIGHT]).astype(np.float32)
    points[:100] = 6.0 * random.integers(0, 26, (100, 2))  # many are exactly 30 pixels apart
    for count in (0, 1, 40):
        others = random.permutation(100)[:count]
        chosen = random.random(2000) < 0.7
        expected = chosen.copy()
        if count:
            expected &= cKDTree(points[others].astype(float)).query(points.astype(float))[0] >= 30.0
        chosen &= ~near_others(points, points[others], 30.0, WIDTH, HEIGHT)
        np.testing.assert_array_equal(chosen, expected)


def test_none_is_spared_that_may_move_or_has_not_been_watched_for_long():
    assert not spare_points(lattice(), motion(evidence=2.1), recent()).any()
    assert not spare_points(lattice(age=11), motion(), recent()).any()  # 0.44 s
    assert spare_points(lattice(age=13), motion(evidence=1.9), recent()).any()


def test_where_the_quota_is_short_new_points_start_near_what_moves():
    """Every coarse cell has its point, all of the image changes, 30 more points may be."""
    taken = LATTICE[(LATTICE % 16 == 2).all(axis=1)].astype(np.float32)
    assert len(taken) == 200
    shares = []
    for moving in (MOVER, MOVER[:0]):
        places = NewPoints(230).places(taken, recent(), None, moving.astype(np.float32))
        assert len(places) == 30
        shares.append((np.linalg.norm(places - MOVER, axis=1) < 40.0).mean())
    assert shares[0] == 1.0
    assert shares[1] < 0.3


def test_points_that_are_spared_are_gone_and_the_others_live_on():
    frames, tracker = RecentFrames(), PointTracker(200)
    gray = np.kron(noise(1)[::8, ::8], np.ones((8, 8), np.uint8))
    for index in range(3):
        status = EgoStatus.OK if index else EgoStatus.FIRST_FRAME
        frames.add(PreparedFrame(gray, 1.0, WIDTH, HEIGHT, (index + 1) * PERIOD_NS),
                   EgoMotion(np.eye(3), np.eye(6), status, (index + 1) * PERIOD_NS, index * PERIOD_NS))
        tracker.track(frames, None)
        points = tracker.start(frames, None)
    spare = points.now[:, 0] < 100
    tracker.told(np.zeros(len(points), bool), spare)
    tracker.track(frames, None)
    after = tracker.start(frames, None)
    assert spare.sum() > 10
    assert not set(points.number[spare]) & set(after.number)
    assert set(points.number[~spare]) & set(after.number)


def test_no_new_point_starts_where_the_mask_hides_the_picture():
    mask = np.ones((HEIGHT, WIDTH), bool)
    mask[:, :WIDTH // 2] = False
    places = NewPoints(400).places(np.zeros((0, 2), np.float32), recent(), mask, MOVER.astype(np.float32))
    assert len(places) == 400
    assert places[:, 0].min() >= WIDTH // 2


@pytest.mark.parametrize(('changed', 'cells'), [
    ([(51, 52)], []),  # two pixels of either cell
    ([(52, 51)], []),  # of either row of cells
    ([(51, 52), (52, 52)], [(20, 20), (21, 20)]),  # three
    ([(51, 51)], [(20, 20)]),  # four
], ids=['two across', 'two down', 'three', 'four'])
def test_a_fine_cell_with_three_pixels_that_changed_gets_a_point(
    changed: list[tuple[int, int]], cells: list[tuple[int, int]], monkeypatch: pytest.MonkeyPatch,
):
    """Those of the halved picture stand for two by two; cell 20 begins at pixel 100, cell 21 at 105."""
    half = np.zeros((HEIGHT // 2, WIDTH // 2), bool)
    half[tuple(np.transpose(changed))] = True
    monkeypatch.setattr(new_points, 'changed_pixels', lambda frames, ago: half)
    taken = LATTICE[(LATTICE % 16 == 2).all(axis=1)].astype(np.float32)
    places = NewPoints(300).places(taken, recent(), None, MOVER[:0].astype(np.float32))
    assert sorted((column, row) for column, row in (places // 5).astype(int).tolist()) == cells
