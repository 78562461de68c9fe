"""Which points move, from their displacements: against the same in NumPy, a baseline at a time."""

from __future__ import annotations

import numpy as np
import pytest

from motion_detect_ros.core.geometry.warp import apply
from motion_detect_ros.core.trajectories import baseline, object_motion
from motion_detect_ros.core.trajectories.baseline import Baseline
from motion_detect_ros.core.trajectories.object_motion import PointMotion
from motion_detect_ros.core.trajectories.points import Points
from motion_detect_ros.core.trajectories.recent_frames import MAX_FRAMES, RecentFrames
from motion_detect_ros.core.types import CameraModel, EgoMotion, EgoStatus, PreparedFrame

PERIOD_NS, WIDTH, HEIGHT = 40_000_000, 640, 360
SECONDS, HALVES = np.array([1.0, 0.48, 0.32, 0.2, 0.12]), [1, 3, 3, 4]
COUNT = 3000


def judged(motion: np.ndarray, background: np.ndarray, noise: np.ndarray, sigmas: np.ndarray) -> PointMotion:
    found = PointMotion.at_rest(motion.shape[1])
    halves = object_motion._halves(SECONDS)
    object_motion._judge(motion, background, noise, sigmas, SECONDS, halves, 4.0, found.velocity, found.sigmas,
                         found.background, found.evidence, found.least_speed)
    return found


def displacements() -> tuple[np.ndarray, ...]:
    """Steady ones of all speeds, with errors of some pixels; each point is too young for some of the baselines."""
    random = np.random.default_rng(7)
    motion = SECONDS[:, None, None] * random.normal(0.0, 12.0, (COUNT, 2)) + random.normal(0.0, 0.7, (5, COUNT, 2))
    motion[np.arange(5)[:, None] < random.integers(0, 6, COUNT)] = np.nan
    noise = random.uniform(0.1, 1.0, (5, COUNT))
    return motion, random.normal(0.0, 3.0, (5, COUNT, 2)), noise, np.linalg.norm(motion, axis=2) / noise


def test_a_point_moves_that_does_so_in_both_parts_of_a_baseline() -> None:
    motion, background, noise, sigmas = displacements()
    length = np.linalg.norm(motion, axis=2)
    used = np.full(COUNT, -1)
    for index, half in reversed(list(enumerate(HALVES))):
        recent = np.einsum('ij,ij->i', motion[half], motion[index]) / length[index]
        share, whole = SECONDS[half] / SECONDS[index], length[index]
        steady = (recent > 0.3 * share * whole) & (whole - recent > 0.3 * (1.0 - share) * whole)
        used[(sigmas[index] > 4.0) & (length[index] > 1.2) & steady] = index
    velocity_of = used.copy()
    for index in range(5):
        velocity_of[(used >= 0) & (index >= used) & (length[index] > 4.0) & (sigmas[index] > 4.0)] = index
    moving, each = used >= 0, np.arange(COUNT)
    found = judged(motion, background, noise, sigmas)
    np.testing.assert_array_equal(found.moving, moving)
    np.testing.assert_allclose(found.sigmas, np.where(moving, sigmas[used, each], 0.0))
    by_second = motion / SECONDS[:, None, None]
    np.testing.assert_allclose(found.velocity, np.where(moving[:, None], by_second[velocity_of, each], 0.0))
    by_second = background / SECONDS[:, None, None]
    np.testing.assert_allclose(found.background, np.where(moving[:, None], by_second[used, each], 0.0))
    assert 0.2 < moving.mean() < 0.8
    assert set(used.tolist()) == {-1, 0, 1, 2, 3} and set(velocity_of.tolist()) == {-1, 0, 1, 2, 3, 4}


def test_evidence_and_least_speed_are_those_of_any_baseline() -> None:
    motion, background, noise, sigmas = displacements()
    found = judged(motion, background, noise, sigmas)
    known = np.isfinite(motion[..., 0])
    long_enough = np.linalg.norm(motion, axis=2) > 1.2
    np.testing.assert_array_equal(found.evidence, np.where(long_enough, sigmas, 0.0).max(axis=0))
    speeds = np.maximum(1.2, 4.0 * noise) / SECONDS[:, None]
    np.testing.assert_allclose(found.least_speed, np.where(known, speeds, np.inf).min(axis=0))
    assert np.isinf(found.least_speed).any()


def test_the_half_of_a_baseline_is_the_shorter_one_closest_to_it() -> None:
    assert object_motion._halves(SECONDS).tolist() == [*HALVES, -1]
    assert object_motion._halves(SECONDS[:0]).tolist() == []


@pytest.mark.parametrize('hertz', [10.0, 12.5, 18.0, 25.0, 30.0, 50.0])
@pytest.mark.parametrize('jitter_s', [1e-9, 5e-4, 2e-3])
def test_a_jitter_of_the_stamps_does_not_choose_another_half(hertz: float, jitter_s: float) -> None:
    """Every baseline is a number of frames long; stamps come so much too early or late."""
    random = np.random.default_rng(0)
    exact = np.array(sorted({round(each * hertz) for each in SECONDS}, reverse=True)) / hertz
    expected = object_motion._halves(exact).tolist()
    for _ in range(60):
        assert object_motion._halves(exact + random.uniform(-jitter_s, jitter_s, len(exact))).tolist() == expected


def ego(matrix: np.ndarray, index: int) -> EgoMotion:
    status = EgoStatus.OK if index else EgoStatus.FIRST_FRAME
    return EgoMotion(matrix, np.eye(6), status, (index + 1) * PERIOD_NS, index * PERIOD_NS)


def recent(matrix: np.ndarray, count: int = 26) -> RecentFrames:
    """``matrix``: the ego-motion of each frame."""
    frames = RecentFrames()
    for index in range(count):
        gray = np.zeros((HEIGHT, WIDTH), np.uint8)
        frames.add(PreparedFrame(gray, 1.0, WIDTH, HEIGHT, (index + 1) * PERIOD_NS), ego(matrix, index))
    return frames


def wandering(speed_px: np.ndarray) -> Points:
    """(N, 2) pixels a frame, of points all over the image, every third of which is two frames old."""
    random = np.random.default_rng(8)
    now = random.random((len(speed_px), 2)) * [WIDTH - 1, HEIGHT - 1]
    path = (now[:, None] - speed_px[:, None] * np.arange(MAX_FRAMES)[:, None]).astype(np.float32)
    age = np.where(np.arange(len(now)) % 3, 25, 2).astype(np.int32)
    path[np.arange(MAX_FRAMES) > age[:, None]] = np.nan
    return Points(path, age, np.zeros((len(now), 2), np.float32))


STEP = np.array([[1.001, 0.002, 0.4], [-0.002, 1.0, -0.3], [1e-6, -2e-6, 1.0]])
CAMERA = CameraModel.guessed(WIDTH, HEIGHT, 1.0)


def test_errors_of_a_baseline_are_those_against_the_ego_motion() -> None:
    points, frames = wandering(np.random.default_rng(9).normal(0.0, 0.5, (900, 2))), recent(STEP)
    old = points.age >= 12
    found = Baseline(points, frames, 12)
    assert len(found) == old.sum() == 600
    expected = points.now[old] - apply(np.linalg.matrix_power(STEP, 12), points.path[old, 12])
    np.testing.assert_allclose(found.error, expected, atol=2e-4)


def test_noise_is_that_around_a_point_and_a_share_of_the_motions_it_was_freed_of() -> None:
    """Without travel of the camera, so that there is no parallax."""
    random = np.random.default_rng(10)
    now, old = (random.random((50, 2)) * 300).astype(np.float32), np.arange(0, 100, 2)
    error, background, local = random.normal(size=(50, 2)), random.normal(size=(50, 2)), random.uniform(0.1, 1.0, 50)
    unexplained, parallax_noise = random.uniform(0.0, 5.0, 50), random.uniform(0.0, 0.3, 50)
    parts = random.uniform(0.1, 2.0, (4, 50))
    back = np.linalg.inv(STEP).astype(np.float32)
    shared = (0.03 * np.linalg.norm(background, axis=1)
              + 0.01 * np.linalg.norm(now - apply(back.astype(float), now), axis=1))
    noise = np.sqrt(local ** 2 + 0.12 ** 2) + shared + parallax_noise
    across = np.sqrt(parts[3] ** 2 + 0.12 ** 2) + shared
    along = np.maximum(across, np.sqrt((2.5 * parts[2]) ** 2 + 0.12 ** 2) + shared)
    relief = np.hypot(parts[0] / along, parts[1] / across)
    for given, sigmas in ((parts, np.minimum(unexplained / noise, relief)), (parts[:, :0], unexplained / noise)):
        out = np.full((2, 100, 2), np.nan), np.full((2, 100), np.nan)
        baseline._significance(old, now, back, error, background, unexplained, parallax_noise, local,
                               np.ascontiguousarray(given), *out[0], *out[1])
        np.testing.assert_array_equal(out[0][:, old], [error, background])
        np.testing.assert_allclose(out[1][:, old], [noise, sigmas], rtol=1e-5)
        assert np.isnan(out[0][:, 1::2]).all() and np.isnan(out[1][:, 1::2]).all()


def test_young_points_have_no_displacement_and_do_not_move() -> None:
    speed = np.zeros((900, 2))
    speed[100:110] = 2.0, 1.0
    points = wandering(speed)
    found = object_motion.object_motion(points, recent(np.eye(3)), CAMERA)
    young = points.age < 3
    assert [np.isnan(each[:, 0]).tolist() for each in found.displacements] == 5 * [young.tolist()]
    np.testing.assert_array_equal(np.flatnonzero(found.moving), [n for n in range(100, 110) if not young[n]])
    np.testing.assert_allclose(found.velocity[found.moving], 25.0 * speed[found.moving], atol=0.1)
    assert np.isinf(found.least_speed[young]).all()


@pytest.mark.parametrize(('pictures', 'seconds'), [(26, [1.0, 0.48, 0.32, 0.2, 0.12]), (13, [0.48, 0.32, 0.2, 0.12])])
def test_ways_are_over_the_seconds_that_the_pictures_reach_back(pictures: int, seconds: list[float]) -> None:
    """50 and 25 px in a second."""
    speed = np.zeros((900, 2))
    speed[100:110] = 2.0, 1.0
    found = object_motion.object_motion(wandering(speed), recent(np.eye(3), pictures), CAMERA)
    assert found.seconds == pytest.approx(seconds)
    for way, over in zip(found.displacements, seconds, strict=True):
        np.testing.assert_allclose(way[[100, 103, 106]], 3 * [[50.0 * over, 25.0 * over]], atol=0.3)


def test_nothing_moves_where_all_points_stand_exactly_still() -> None:
    """As in pictures without noise: there are no lines to an epipole."""
    points = wandering(np.zeros((900, 2)))
    found = object_motion.object_motion(points, recent(np.eye(3)), CAMERA)
    assert not found.moving.any() and not found.evidence.any()


def test_too_few_points_tell_nothing() -> None:
    found = object_motion.object_motion(wandering(np.zeros((80, 2))), recent(np.eye(3)), CAMERA)
    assert found.displacements == ()
    assert not found.moving.any()


def test_the_significance_asked_for_can_be_changed(monkeypatch: pytest.MonkeyPatch) -> None:
    """Compiled code holds constants as they were."""
    speed = np.zeros((900, 2))
    speed[::10] = 0.1, 0.0
    points, frames = wandering(speed), recent(np.eye(3))
    assert object_motion.object_motion(points, frames, CAMERA).moving.any()
    monkeypatch.setattr(object_motion, 'MOVING_SIGMAS', 100.0)
    assert not object_motion.object_motion(points, frames, CAMERA).moving.any()
