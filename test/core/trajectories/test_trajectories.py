"""Long point trajectories: against exact warps, exact parallax and rendered scenes."""

from __future__ import annotations

import threading
from dataclasses import replace
from itertools import pairwise
from typing import Any

import cv2
import numpy as np
import pytest
from point_objects import PointObjects

from motion_detect_ros.core import deferred
from motion_detect_ros.core.detection.candidate import Candidate
from motion_detect_ros.core.geometry.lucas_kanade import LEAST_POINTS
from motion_detect_ros.core.geometry.warp import apply
from motion_detect_ros.core.pipeline import MotionPipeline
from motion_detect_ros.core.settings import with_settings
from motion_detect_ros.core.threads import limited
from motion_detect_ros.core.trajectories import clusters
from motion_detect_ros.core.trajectories import points as points_module
from motion_detect_ros.core.trajectories.clusters import Cluster
from motion_detect_ros.core.trajectories.object_motion import PointMotion, object_motion
from motion_detect_ros.core.trajectories.points import Points, PointTracker
from motion_detect_ros.core.trajectories.recent_frames import MAX_FRAMES, RecentFrames
from motion_detect_ros.core.trajectories.union import united
from motion_detect_ros.core.types import CameraModel, EgoMotion, EgoStatus, PreparedFrame
from motion_detect_ros.presets import load_preset
from motion_detect_ros.sources.synthetic import FlightConfig, SyntheticFlight

PERIOD_NS = 40_000_000
SECOND = 25


def smooth_texture(seed: int, height: int, width: int, sigma: float = 1.5) -> np.ndarray:
    noise = cv2.GaussianBlur(np.random.default_rng(seed).normal(size=(height, width)), (0, 0), sigma)
    return cv2.normalize(noise, None, 20, 235, cv2.NORM_MINMAX).astype(np.uint8)


def warped(picture: np.ndarray, matrix: np.ndarray, width: int, height: int) -> np.ndarray:
    return cv2.warpAffine(picture, matrix[:2], (width, height), flags=cv2.INTER_LANCZOS4)


def prepared(gray: np.ndarray, index: int) -> PreparedFrame:
    return PreparedFrame(gray, 1.0, gray.shape[1], gray.shape[0], (index + 1) * PERIOD_NS)


def ego(matrix: np.ndarray, index: int) -> EgoMotion:
    status = EgoStatus.OK if index else EgoStatus.FIRST_FRAME
    return EgoMotion(matrix, np.eye(6), status, (index + 1) * PERIOD_NS, index * PERIOD_NS)


def step(tracker: PointTracker, frames: RecentFrames, mask: np.ndarray | None = None) -> Points:
    tracker.track(frames, mask)
    return tracker.start(frames, mask)


class TestPoints:
    def test_they_follow_an_exact_warp_for_a_second(self) -> None:
        turn = np.vstack([cv2.getRotationMatrix2D((240, 180), 0.3, 1.002), [0, 0, 1]])
        turn[:2, 2] += 1.3, -0.7
        ground = smooth_texture(1, 560, 680)
        offset = np.array([[1, 0, -100], [0, 1, -100], [0, 0, 1]], float)
        frames, tracker, points = RecentFrames(), PointTracker(3000), Points()
        for index in range(SECOND + 1):
            matrix = np.linalg.matrix_power(turn, index)
            frames.add(prepared(warped(ground, matrix @ offset, 480, 360), index), ego(turn, index))
            points = step(tracker, frames)
        old = points.age >= SECOND
        true = apply(np.linalg.matrix_power(turn, SECOND), points.path[old, SECOND])
        error = np.hypot(*(points.now[old] - true).T)
        assert old.sum() > 200
        assert np.median(error) < 0.2
        assert np.percentile(error, 95) < 0.4

    def test_a_missing_ego_motion_clears_them(self) -> None:
        gray = smooth_texture(1, 200, 300)
        frames, tracker = RecentFrames(), PointTracker(500)
        for index in range(4):
            frames.add(prepared(gray, index), ego(np.eye(3), index))
            points = step(tracker, frames)
        assert points.age.max() == 3
        assert not frames.add(prepared(gray, 4), replace(ego(np.eye(3), 4), status=EgoStatus.LOW_TEXTURE))
        assert step(tracker, frames).age.max() == 0

    def test_those_that_come_to_lie_beside_or_in_what_is_masked_go_and_no_others(self) -> None:
        gray, mask = smooth_texture(1, 200, 300), np.ones((200, 300), np.bool_)
        mask[20:80, 200:280] = False
        frames, tracker = RecentFrames(), PointTracker(500)
        for index in range(2):
            frames.add(prepared(gray, index), ego(np.eye(3), index))
            before = step(tracker, frames)
        frames.add(prepared(gray, 2), ego(np.eye(3), 2))
        after = tracker.track(frames, mask)
        outside = np.maximum.reduce([200 - before.now[:, 0], before.now[:, 0] - 279,
                                     20 - before.now[:, 1], before.now[:, 1] - 79])  # pixels from the masked ones
        stay = set(after.number.tolist())
        assert set(before.number[outside > points_module.MASKED_PX + 1].tolist()) <= stay
        assert not stay & set(before.number[outside < 1].tolist())
        assert np.sum(outside < 1) > 10

    def test_half_of_them_is_tracked_back_in_each_frame_and_all_in_two(self, monkeypatch: pytest.MonkeyPatch) -> None:
        back: list[np.ndarray] = []
        track = points_module._lucas_kanade

        def seen(one: np.ndarray, other: np.ndarray, places: np.ndarray, *others: Any) -> Any:
            if one is current:
                back.append(np.rint(track(one, other, places, *others)[0] / 2))
            return track(one, other, places, *others)

        monkeypatch.setattr(points_module, '_lucas_kanade', seen)
        ground, frames, tracker = smooth_texture(3, 360, 480), RecentFrames(), PointTracker(1000)
        checked = list[set[tuple[float, float]]]()
        for index in range(10):
            current = ground.copy()
            frames.add(prepared(current, index), ego(np.eye(3), index))
            back.clear()
            points = step(tracker, frames)
            checked.append({tuple(place) for places in back for place in places.tolist()})
        standing = {tuple(place) for place in np.rint(points.now[points.age > 2] / 2).tolist()}
        assert len(standing) > 400
        for one, other in pairwise(checked[4:]):
            assert 0.4 * len(standing) < len(one & standing) < 0.6 * len(standing)
            assert standing <= one | other

    def test_are_the_same_by_two_threads(self) -> None:
        """Some fail at first: a step of 9 px is beyond their window."""
        ground, found = smooth_texture(3, 360, 520), []
        for threads in (1, 2):
            frames, tracker = RecentFrames(), PointTracker(2000)
            with limited(threads):
                for index, left in enumerate((0, 0, 1, 10, 11, 12)):
                    frames.add(prepared(np.ascontiguousarray(ground[:, left:left + 480]), index), ego(np.eye(3), index))
                    found.append(step(tracker, frames))
        for one, other in zip(found[:6], found[6:], strict=True):
            np.testing.assert_array_equal(one.now, other.now)
            np.testing.assert_array_equal(one.number, other.number)
        assert len(found[5]) > 2 * LEAST_POINTS and (found[5].age == 5).any()

    def test_none_in_the_mask(self) -> None:
        gray, mask = smooth_texture(1, 200, 300), np.ones((200, 300), bool)
        mask[:, :150] = False
        frames = RecentFrames()
        frames.add(prepared(gray, 0), ego(np.eye(3), 0))
        points = step(PointTracker(500), frames, mask)
        assert len(points) > 50
        assert points.now[:, 0].min() >= 150

    @staticmethod
    def jump(seed: int, starts_in: int) -> tuple[np.ndarray, np.ndarray]:
        """(n, 2) ways, and (n,) numbers, of points inside a body of 72 px in the frame in which it starts to go 18 px a
        frame.
        """
        ground, body = (cv2.normalize(np.mean([smooth_texture(2 * seed + each, 200, 300, sigma)
                                               for sigma in (1.0, 2.0, 4.0, 8.0)], axis=0),
                                      None, 0, 255, cv2.NORM_MINMAX).astype(np.uint8) for each in (0, 1))
        frames, tracker, points = RecentFrames(), PointTracker(1000), Points()
        for index in range(starts_in + 2):
            left = 60 + 18 * max(0, index - starts_in)
            picture = ground.copy()
            picture[60:132, left:left + 72] = body[:72, :72]
            frames.add(prepared(picture, index), ego(np.eye(3), index))
            points = step(tracker, frames)
        since_start = points.age > starts_in
        x, y = points.path[since_start, 1].T
        inside = (x > 70) & (x < 122) & (y > 70) & (y < 122)
        return (points.now - points.path[:, 1])[since_start][inside], points.number[since_start][inside]

    @pytest.mark.parametrize('starts_in', [0, 5], ids=['new points', 'old points'])
    def test_points_of_what_goes_a_quarter_of_its_size_a_frame_go_with_it(self, starts_in: int) -> None:
        """Texture of all scales, as pictures have: the coarse one leads the tracker to the fine one."""
        ways = np.concatenate([self.jump(seed, starts_in)[0] for seed in range(8)])
        right = np.abs(ways - [18.0, 0.0]).max(axis=1) < 0.3
        assert right.sum() >= 16
        assert right.mean() >= 0.4  # some settle on what looks alike nearby, until they are tracked back

    def test_what_was_found_far_from_where_it_was_looked_for_is_found_on_its_way_back(self) -> None:
        """In the frame in which the body starts every second point is tracked back."""
        ways, numbers = (np.concatenate(each) for each in zip(*(self.jump(seed, 5) for seed in range(8)), strict=True))
        right = np.abs(ways - [18.0, 0.0]).max(axis=1) < 0.3
        checked = numbers % 2 == 0
        assert (right & checked).sum() >= 16
        assert right[checked].mean() > 0.75
        assert right[~checked].mean() < 0.6  # the others settled on what looks alike nearby


class TestObjectMotion:
    """Points of a plane, of raised blocks and of one car, seen by a camera that travels: positions are exact."""

    CAMERA = CameraModel(640, 360, 560.0, 560.0, 319.5, 179.5)
    PITCH = np.radians(50.0)

    def project(self, world: np.ndarray, x_m: float) -> np.ndarray:
        """Camera 40 m up, looks ahead and down, at ``x_m`` to the right of its start."""
        right, ahead, up = (world - [x_m, 0.0, 40.0]).T
        down = -up
        z = ahead * np.cos(self.PITCH) + down * np.sin(self.PITCH)
        y = down * np.cos(self.PITCH) - ahead * np.sin(self.PITCH)
        return np.stack([560.0 * right / z + 319.5, 560.0 * y / z + 179.5], axis=1)

    def motion(self, own_m_s: float, camera_m: float = 6.0, built_up: bool = False) -> PointMotion:
        """Of 1500 points of the plane, 200 or all over it 3000 of the blocks, 20 of the car."""
        random = np.random.default_rng(3)
        ground = np.column_stack([random.uniform(-18, 22, 1500), random.uniform(20, 50, 1500), np.zeros(1500)])
        count, left, right, near, far = (3000, -18, 22, 20, 50) if built_up else (200, -10, 10, 25, 40)
        blocks = np.column_stack([
            random.uniform(left, right, count), random.uniform(near, far, count), random.uniform(2, 8, count)])
        car = np.column_stack([random.uniform(3, 5, 20), random.uniform(30, 32, 20), np.zeros(20)])
        world, own = np.vstack([ground, blocks, car]), np.zeros((1520 + count, 3))
        own[-20:, 1] = own_m_s
        path = np.full((len(world), MAX_FRAMES, 2), np.nan, np.float32)
        for ago in range(SECOND + 1):
            at = self.project(world - own * (ago / SECOND), camera_m * (1 - ago / SECOND))
            path[:, ago] = at + random.normal(0, 0.05, at.shape)
        points = Points(path, np.full(len(world), SECOND, np.int32), np.zeros((len(world), 2), np.float32))
        frames = RecentFrames()
        for index in range(SECOND + 1):
            earlier, later = path[:1500, SECOND - index], path[:1500, max(0, SECOND - index - 1)]
            affine, _ = cv2.estimateAffine2D(np.ascontiguousarray(earlier), np.ascontiguousarray(later))
            matrix = np.vstack([affine, [0, 0, 1]])
            frames.add(prepared(np.zeros((360, 640), np.uint8), index), ego(matrix, index))
        return object_motion(points, frames, self.CAMERA)

    def test_a_car_moves_and_raised_blocks_do_not(self) -> None:
        ground, blocks, car = np.split(self.motion(own_m_s=3.0).moving, [1500, 1700])
        assert ground.mean() < 0.01
        assert blocks.mean() < 0.05
        assert car.mean() > 0.9

    def test_nothing_moves(self) -> None:
        assert not self.motion(own_m_s=0.0).moving.mean() > 0.01

    def test_relief_hides_no_car_that_crosses_the_way_of_parallax(self) -> None:
        """Two points of three are raised: the camera's travel explains their 3 pixels along x, not the car's 2.6."""
        motion = self.motion(own_m_s=0.3, camera_m=2.0, built_up=True)
        _, blocks, car = np.split(motion.displacements[0], [1500, 4500])
        assert np.median(np.abs(blocks[:, 0])) > 2.5
        assert 2.0 < np.median(np.linalg.norm(car, axis=1)) < 3.0
        ground, blocks, car = np.split(motion.moving, [1500, 4500])
        assert ground.mean() < 0.01
        assert blocks.mean() < 0.02
        assert car.mean() > 0.9

    def test_evidence_is_that_beyond_parallax(self) -> None:
        """The blocks go 8 pixels and more against the plane in a second, as the camera's travel explains."""
        motion = self.motion(own_m_s=3.0)
        way = [np.linalg.norm(part, axis=1) for part in np.split(motion.displacements[0], [1500, 1700])]
        _, blocks, car = np.split(motion.evidence, [1500, 1700])
        assert np.median(way[1]) > 8.0
        assert np.median(blocks) < 1.5
        assert np.median(car) > 5.0

    def test_from_the_least_speed_on_motion_is_significant(self) -> None:
        fast, slow = self.motion(own_m_s=3.0), self.motion(own_m_s=0.02)
        for motion, is_told in ((fast, True), (slow, False)):
            speed = np.linalg.norm(motion.displacements[0][1700:], axis=1)  # over a second
            assert (np.median(speed) > np.median(motion.least_speed[1700:])) == is_told
            assert (motion.moving[1700:].mean() > 0.5) == is_told


SIDE, SPEED = 14, 0.8
START = np.array([200.0, 150.0])
GROUND, THING = smooth_texture(1, 500, 700), smooth_texture(2, SIDE, SIDE, 1.0)


def small_mover(index: int, speed: float = SPEED) -> np.ndarray:
    """The camera drifts over textured ground, a square of 14 px moves on it at 0.8 px a frame, or another speed."""
    pan = np.array([[1, 0, -60 - 1.3 * index], [0, 1, -60 - 0.4 * index], [0, 0, 1]], float)
    picture = warped(GROUND, pan, 480, 320)
    place = corner(index, speed)
    shift = np.array([[1, 0, place[0]], [0, 1, place[1]], [0, 0, 1]], float)
    cover = warped(np.full((SIDE, SIDE), 255, np.uint8), shift, 480, 320).astype(float) / 255.0
    framed = cv2.copyMakeBorder(THING, 2, 2, 2, 2, cv2.BORDER_REPLICATE)
    shift[:2, 2] -= 2
    thing = warped(framed, shift, 480, 320)
    return np.rint(cover * thing + (1.0 - cover) * picture).clip(0, 255).astype(np.uint8)


def corner(index: int, speed: float = SPEED) -> np.ndarray:
    return START + index * np.array([speed - 1.3, -0.4])


def overlap(record: np.void, index: int) -> float:
    size = np.array([record['width'], record['height']])
    low = np.array([record['u'], record['v']]) - size / 2
    shared = np.clip(np.minimum(low + size, corner(index) + SIDE) - np.maximum(low, corner(index)), 0, None).prod()
    return float(shared / (size.prod() + SIDE ** 2 - shared))


def run(use: bool, frames: int = 40) -> list[np.ndarray]:
    pipeline = MotionPipeline(with_settings(load_preset('visdrone'), {'trajectories.use': use}))
    return [pipeline.process(small_mover(index), (index + 1) * PERIOD_NS).detections for index in range(frames)]


def test_a_small_square_gets_points_though_all_of_the_image_changes() -> None:
    """Noise in blobs everywhere: standing points could fill the quota of 1200, of which the square needs 10."""
    finder = PointObjects(with_settings(load_preset('visdrone'), {'trajectories.max_points': 1200}))
    pan = np.array([[1, 0, -1.3], [0, 1, -0.4], [0, 0, 1]])
    found = []
    for index in range(50):
        blobs = np.random.default_rng(1000 + index).normal(0.0, 6.0, (107, 160)).astype(np.float32)
        noisy = small_mover(index) + cv2.resize(blobs, (480, 320), interpolation=cv2.INTER_NEAREST)
        candidates = finder.candidates(prepared(noisy.clip(0, 255).astype(np.uint8), index), ego(pan, index),
                                       CameraModel.guessed(480, 320, 1.0))
        centre = corner(index) + SIDE / 2
        found.append(any((np.abs(each.centre - centre) < SIDE / 2).all() for each in candidates))
    assert np.mean(found[25:]) > 0.8


@pytest.mark.parametrize(('share', 'reported'), [(0.001, False), (0.003, True)])
def test_larger_objects_than_the_setting_allows_are_dropped(share: float, reported: bool) -> None:
    """The square is 14 x 14 of 480 x 320 pixels, 0.0013 of them."""
    finder = PointObjects(with_settings(load_preset('visdrone'), {'objects.max_area_share': share}))
    pan = np.array([[1, 0, -1.3], [0, 1, -0.4], [0, 0, 1]])
    found = [finder.candidates(prepared(small_mover(index), index), ego(pan, index), CameraModel.guessed(480, 320, 1.0))
             for index in range(40)]
    assert any(found) == reported


@pytest.mark.parametrize(('hz', 'at_once'), [(10, True), (15, True), (20, False), (25, False), (30, False)])
def test_objects_are_found_behind_the_frame_where_the_next_one_comes_soon(
    monkeypatch: pytest.MonkeyPatch, hz: int, at_once: bool,
) -> None:
    """Either way boxes lie where the square is in the frame they are given for."""
    finder, clustered, period_ns = PointObjects(load_preset('visdrone')), list[int](), 10 ** 9 // hz

    def find_clusters(
        points: Points, motion: PointMotion, old: np.ndarray, frames: RecentFrames, usual_area: float | None,
    ) -> list[Cluster]:
        clustered.append(frames[0].stamp_ns // period_ns - 1)
        return clusters.find_clusters(points, motion, old, frames, usual_area)

    monkeypatch.setattr('motion_detect_ros.core.trajectories.finder.find_clusters', find_clusters)
    pan = np.array([[1, 0, -1.3], [0, 1, -0.4], [0, 0, 1]])
    found_for, ahead_px = [], []
    for index in range(3 * hz):
        frame = replace(prepared(small_mover(index, 4.0), index), stamp_ns=(index + 1) * period_ns)
        motion = replace(ego(pan, index), stamp_ns=frame.stamp_ns, prev_stamp_ns=index * period_ns)
        found = finder.candidates(frame, motion, CameraModel.guessed(480, 320, 1.0))
        if finder.finder.found:
            found_for.append(index)
            ahead_px += [each.centre[0] - corner(index, 4.0)[0] - SIDE / 2 for each in found]
    delay, last = 0 if at_once else 1, range(3 * hz - 20, 3 * hz - 9)  # before the square comes to the border
    late = [index for index in clustered if index in last]
    assert set(np.diff(late)) == {3 if hz > 20 else 2}
    assert [index for index in found_for if index - delay in last] == [index + delay for index in late]
    assert len(ahead_px) > len(found_for) / 2
    assert abs(np.median(ahead_px)) < 1.0, 'of 2.7 a frame'


@pytest.mark.parametrize('anew', [False, True], ids=['goes on', 'starts anew'])
def test_a_frame_whose_objects_are_never_asked_for_costs_that_frame(anew: bool) -> None:
    """Its points were followed. anew: without a motion into it, and numbers of points come again."""
    by, pan = PointObjects(load_preset('visdrone')), np.array([[1, 0, -1.3], [0, 1, -0.4], [0, 0, 1]])
    camera, found = CameraModel.guessed(480, 320, 1.0), dict[int, bool]()
    for index in range(60):
        motion, off = ego(pan, index), corner(index, 4.0) + SIDE / 2
        if index == 33:
            by.follower.follow(prepared(small_mover(index, 4.0), index), replace(
                motion, status=EgoStatus.LOW_TEXTURE if anew else EgoStatus.OK), camera)
            continue
        boxes = by.candidates(prepared(small_mover(index, 4.0), index), motion, camera)
        found[index] = len(boxes) == 1 and bool((np.abs(boxes[0].centre - off) < SIDE / 2).all())
        assert not (anew and 33 < index < 37 and boxes), 'nothing is known of the points yet'
    assert all(found[index] for index in range(29, 33))
    assert anew or all(found[index] for index in range(34, 44))
    assert all(found[index] for index in range(44, 60))


def test_objects_do_not_live_on_where_no_point_does() -> None:
    """Numbers of points come again then, as they do here."""
    by, pan = PointObjects(load_preset('visdrone')), np.array([[1, 0, -1.3], [0, 1, -0.4], [0, 0, 1]])
    camera = CameraModel.guessed(480, 320, 1.0)
    for index in range(33):
        assert by.candidates(prepared(small_mover(index, 4.0), index), ego(pan, index), camera) or index < 29
    followed = by.follower.follow(prepared(small_mover(33, 4.0), 33), ego(pan, 33), camera)
    assert by.finder.candidates(replace(followed, run=followed.run + 1, shows_motion=False)) == []


def test_no_answer_waits_for_objects_that_are_looked_for_behind_it(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(deferred, 'threads', lambda: 2)
    finder, may_go_on, waited = PointObjects(load_preset('visdrone')), threading.Event(), list[bool]()

    def find_clusters(*given: object) -> list[Cluster]:
        if threading.current_thread() is not threading.main_thread():
            waited.append(may_go_on.wait(60.0))
        return clusters.find_clusters(*given)  # type: ignore[arg-type]

    monkeypatch.setattr('motion_detect_ros.core.trajectories.finder.find_clusters', find_clusters)
    for index in range(40):
        may_go_on.set()  # what the last frame has left over must end for this one
        finder.wait()
        may_go_on.clear()
        finder.candidates(prepared(small_mover(index, 4.0), index), ego(np.eye(3), index),
                          CameraModel.guessed(480, 320, 1.0))
    may_go_on.set()
    finder.reset()
    assert len(waited) >= 3, 'not one frame left its objects to a thread'
    assert all(waited), 'candidates() waited for the thread'


class TestPipeline:
    def test_small_slow_square_is_found_by_its_points_alone(self) -> None:
        def found(runs: list[np.ndarray]) -> list[bool]:
            return [any(overlap(record, index) > 0.3 for record in runs[index]) for index in range(25, 40)]

        assert np.mean(found(run(use=True))) > 0.8
        assert np.mean(found(run(use=False))) < 0.2

    def test_same_input_same_bytes_and_reset_forgets(self) -> None:
        pipeline = MotionPipeline(with_settings(load_preset('visdrone'), {'trajectories.use': True}))

        def once() -> list[bytes]:
            records = [pipeline.process(small_mover(index), (index + 1) * PERIOD_NS).detections for index in range(25)]
            for each in records:
                each['id'] = 0  # ids go on counting
            return [each.tobytes() for each in records]

        first = once()
        pipeline.reset()
        assert once() == first
        assert any(first)

    @pytest.mark.parametrize('preset', ['visdrone', 'default'])
    def test_a_town_where_nothing_moves_is_silent(self, preset: str) -> None:
        config = with_settings(load_preset(preset), {'trajectories.use': True})
        pipeline = MotionPipeline(config)
        flight = SyntheticFlight(FlightConfig(
            cars=0, people=0, seed=2, frames=60, width=640, height=360, focal_px=480.0))
        found = sum(len(pipeline.process(frame.image, frame.stamp_ns).detections) for frame in flight)
        assert found <= 1


    def test_a_masked_hull_gives_no_objects_along_its_edge(self) -> None:
        """It stands still while the ground goes by: a window that sees both would follow it, and seem to move."""
        left, right, top, width, height = 290, 670, 440, 960, 540
        pipeline = MotionPipeline(with_settings(load_preset('visdrone'), {
            'preprocessing.ignore_regions': f'{left},{top},{right - left},{height - top}'}))
        hull = np.kron(np.indices((height // 16 + 1, width // 16 + 1)).sum(axis=0) % 2, np.ones((16, 16)))
        hull = (255 * hull[top:height, left:right]).astype(np.uint8)
        ground, found = (0.3 * smooth_texture(3, 700, 1300)).astype(np.uint8) + np.uint8(80), 0
        for index in range(50):
            picture = ground[2 * index:2 * index + height, 3 * index:3 * index + width].copy()
            picture[top:, left:right] = hull
            found += len(pipeline.process(picture, (index + 1) * PERIOD_NS).detections)
        assert found == 0


def candidate(x: float, side: float, log_odds: float, speed: float = 20.0) -> Candidate:
    return Candidate(np.array([x, 100.0]), np.array([side, side]), np.array([speed, 0.0]), side * side, log_odds, 0)


LARGEST_PX = 100.0


class TestUnion:
    def test_two_views_of_one_object_are_averaged(self) -> None:
        flow, points = candidate(100, 20, 1.0), candidate(102, 16, 0.0, speed=25.0)
        one, = united([flow], [points], LARGEST_PX)
        np.testing.assert_allclose(one.centre, [0.3 * 100 + 0.7 * 102, 100.0])
        np.testing.assert_allclose(one.size, 0.3 * 20 + 0.7 * 16)
        assert one.log_odds == 1.0
        assert one.velocity_px_s[0] == 25.0

    def test_flow_gives_way_to_the_neighbours_that_it_cannot_tell_apart(self) -> None:
        both, left, right = candidate(100, 40, 3.0), candidate(90, 18, 0.0), candidate(110, 18, 0.0, speed=30.0)
        assert united([both], [left, right], LARGEST_PX) == [left, right]

    def test_one_source_alone(self) -> None:
        one = candidate(100, 20, -3.0)
        assert united([one], [], LARGEST_PX) == [one]
        assert united([], [one], LARGEST_PX) == [one]

    def test_others_stay(self) -> None:
        one, other = candidate(100, 20, 1.0), candidate(160, 16, 0.0)
        assert united([one], [other], LARGEST_PX) == [one, other]

    def test_a_part_beside_a_larger_object_of_its_velocity_is_dropped(self) -> None:
        body, part = candidate(100, 40, 1.0), candidate(126, 12, 0.0)
        assert united([body], [part], LARGEST_PX) == [body]
        against = candidate(126, 12, 0.0, speed=-20.0)
        assert united([body], [against], LARGEST_PX) == [body, against]

    def test_a_part_is_one_of_what_both_views_show_together(self) -> None:
        flow, points, part = candidate(100, 34, 1.0), candidate(100, 20, 0.0), candidate(124, 17.4, 0.0)
        assert united([part], [points], LARGEST_PX) == [part, points], '400 pixels are less than 1.5 times 303'
        one, = united([flow, part], [points], LARGEST_PX)  # (0.7 * 20 + 0.3 * 34) ** 2 are more
        np.testing.assert_allclose(one.size, 24.2)

    def test_parts_of_what_is_larger_than_points_show_give_way_unless_they_cover_it(self) -> None:
        bus, window = candidate(200, 120, 1.0), candidate(180, 30, 1.0)
        assert united([bus], [window], LARGEST_PX) == [bus]
        faster = candidate(180, 30, 1.0, speed=30.0)
        assert united([bus], [faster], LARGEST_PX) == [bus], 'however its part moves'
        one, other = candidate(170, 60, 1.0), candidate(230, 60, 1.0)
        one.size[1] = other.size[1] = 120.0
        assert united([bus], [one, other], LARGEST_PX) == [one, other]
        doubtful = candidate(200, 120, -1.0)
        assert united([doubtful], [window], LARGEST_PX) == [window]
