"""The camera's motion in space, from tracks of scenes whose geometry is exact."""

from __future__ import annotations

from dataclasses import replace

import cv2
import numpy as np
import pytest
from street import CAMERA, COLUMNS, HEIGHT, ROWS, flow, motion, pixels, rays, street_depth

from motion_detect_ros.core.config import EgoMotionConfig, PipelineConfig, PreprocessingConfig
from motion_detect_ros.core.ego_motion.alternatives.relative_pose import (
    RelativePoseEstimator,
    plane_seen_now,
    rotation_only,
)
from motion_detect_ros.core.ego_motion.stage import EgoMotionStage
from motion_detect_ros.core.errors import ConfigError
from motion_detect_ros.core.geometry.epipolar import PoseEstimate
from motion_detect_ros.core.preprocessing.stage import Preprocessor
from motion_detect_ros.core.types import CameraModel, EgoMotion, RelativePose

TRACKS, MOVERS, PERIOD_NS = 700, 0.15, 50_000_000
DRIVES = {
    'straight': ((0.0, 0.0, 0.0), (0.0, 0.0, 1.0)),
    'curve': ((0.002, 0.03, -0.001), (0.1, 0.02, 1.2)),
    'backwards': ((0.0, -0.01, 0.0), (0.0, 0.0, -0.7)),
    'slow': ((0.0, 0.002, 0.0), (0.0, 0.0, 0.15)),
}


def tracks(drive, movers=0.0, noise_px=0.0, depth=None):
    """Earlier and current pixels of points all over the picture; the movers all go the same way."""
    random = np.random.default_rng(4)
    own_m = np.zeros((ROWS, COLUMNS, 3))
    own_m[random.random((ROWS, COLUMNS)) < movers] = (0.4, 0.0, 0.1)
    now = pixels().reshape(-1, 2)
    earlier = now - flow(street_depth() if depth is None else depth, *motion(*drive), own_m).reshape(-1, 2)
    some = random.choice(len(now), TRACKS, replace=False)
    return earlier[some] + random.normal(0.0, noise_px, (TRACKS, 2)), now[some]


def estimate(earlier, now, camera=CAMERA) -> RelativePose | None:
    return RelativePoseEstimator(0.9).estimate(earlier, now, CAMERA.width, CAMERA.height, camera)


def degrees_between(a: np.ndarray, b: np.ndarray) -> float:
    return float(np.degrees(np.arccos(np.clip(a @ b / np.linalg.norm(a) / np.linalg.norm(b), -1.0, 1.0))))


def degrees_turned(a: np.ndarray, b: np.ndarray) -> float:
    return float(np.degrees(np.linalg.norm(cv2.Rodrigues(a.T @ b)[0])))


@pytest.mark.parametrize(('noise_px', 'epipole_px', 'height_share'), [(0.0, 2.0, 0.05), (0.1, 4.0, 0.1)])
@pytest.mark.parametrize('movers', [0.0, MOVERS])
@pytest.mark.parametrize('drive', DRIVES)
def test_street(drive, movers, noise_px, epipole_px, height_share):
    rotation, translation = motion(*DRIVES[drive])
    found = estimate(*tracks(DRIVES[drive], movers, noise_px))
    assert degrees_turned(found.rotation, rotation) < 0.05
    assert degrees_between(found.direction, translation) < 1.0
    assert np.linalg.norm(found.direction) == pytest.approx(1.0)
    epipole = translation[:2] / translation[2] * CAMERA.fx + [CAMERA.cx, CAMERA.cy]
    assert np.hypot(*(found.epipole - epipole)) < epipole_px
    # The plane g . X = 1 lies HEIGHT under the earlier camera, in units of the way travelled, and the camera turns.
    assert degrees_between(found.ground, rotation @ [0.0, 1.0, 0.0]) < 1.0
    below = HEIGHT + (rotation.T @ translation)[1]
    assert np.linalg.norm(translation) / np.linalg.norm(found.ground) == pytest.approx(below, rel=height_share)


@pytest.mark.parametrize('lens', [
    {'distortion': (-0.28, 0.07, 0.0005, -0.0003, 0.0)},
    {'distortion': (0.05, -0.01, 0.002, 0.0), 'fisheye': True}], ids=['plumb_bob', 'equidistant'])
@pytest.mark.parametrize('drive', ['straight', 'curve'])
def test_the_lens_of_the_camera_does_not_matter(drive, lens):
    """The tracks as another lens shows them: the same motion, and the epipole where that lens shows it."""
    camera = replace(CAMERA, **lens)
    plain = estimate(*tracks(DRIVES[drive]))

    def distorted(points: np.ndarray) -> np.ndarray:
        plane = (points - [CAMERA.cx, CAMERA.cy]) / [CAMERA.fx, CAMERA.fy]
        project = cv2.fisheye.projectPoints if camera.fisheye else cv2.projectPoints
        return project(np.c_[plane, np.ones(len(plane))].reshape(-1, 1, 3), np.zeros(3), np.zeros(3), camera.matrix,
                       np.array(camera.distortion))[0].reshape(-1, 2)

    found = estimate(*map(distorted, tracks(DRIVES[drive])), camera)
    assert degrees_turned(found.rotation, plain.rotation) < 0.02
    assert degrees_between(found.direction, plain.direction) < 0.2
    assert found.epipole == pytest.approx(distorted(plain.epipole[None])[0], abs=1.0)


def test_what_the_lens_has_no_ray_for_says_nothing():
    """Round the picture of a lens as wide as the sky stands its own rim, which does not move."""
    camera = replace(CAMERA, distortion=(0.0, 0.0, 0.0, 0.0), fisheye=True)

    def with_rim(points: np.ndarray) -> np.ndarray:
        plane = (points - [CAMERA.cx, CAMERA.cy]) / [CAMERA.fx, CAMERA.fy]
        radius = np.hypot(*plane.T)[:, None]
        shown = plane / radius * np.arctan(radius)  # r = f * angle
        turn = np.linspace(0.0, 2.0 * np.pi, len(points) // 2, endpoint=False)
        rim = 1.65 * np.c_[np.cos(turn), np.sin(turn)]  # 95 degrees from the axis
        return np.r_[shown, rim] * [CAMERA.fx, CAMERA.fy] + [CAMERA.cx, CAMERA.cy]

    plain, found = estimate(*tracks(DRIVES['curve'])), estimate(*map(with_rim, tracks(DRIVES['curve'])), camera)
    assert found is not None
    assert degrees_turned(found.rotation, plain.rotation) < 0.02
    assert degrees_between(found.direction, plain.direction) < 0.2


def test_travel_parallel_to_the_picture_has_no_epipole_in_it():
    drive = ((0.0, 0.01, 0.0), (0.8, 0.0, 0.1))
    found = estimate(*tracks(drive, MOVERS))
    assert degrees_between(found.direction, motion(*drive)[1]) < 1.0
    assert abs(found.epipole[0]) > CAMERA.width


@pytest.mark.parametrize('movers', [0.0, MOVERS])
@pytest.mark.parametrize('noise_px', [0.0, 0.3])
@pytest.mark.parametrize('turn', [(0.0, 0.0, 0.0), (0.01, 0.03, 0.005)])
def test_a_turn_alone_gives_none(turn, noise_px, movers):
    assert estimate(*tracks((turn, (0.0, 0.0, 0.0)), movers, noise_px)) is None


def test_turn_alone_is_exact_under_movers():
    turn = (0.01, 0.03, 0.005)
    scale, middle = np.array([CAMERA.fx, CAMERA.fy]), np.array([CAMERA.cx, CAMERA.cy])
    earlier, now = ((points - middle) / scale for points in tracks((turn, (0.0, 0.0, 0.0)), MOVERS))
    assert degrees_turned(rotation_only(earlier, now), motion(turn, (0.0, 0.0, 0.0))[0]) < 0.001


def from_above(standing: float) -> tuple[np.ndarray, np.ndarray]:
    """(ROWS, COLUMNS) depth of flat ground 50 m under a camera that looks 60 degrees down, and its normal.

    standing: share of the points that are on things up to 25 m high.
    """
    normal = np.array([0.0, np.cos(np.radians(60.0)), np.sin(np.radians(60.0))])
    random = np.random.default_rng(5)
    height = np.where(random.random((ROWS, COLUMNS)) < standing, random.uniform(5.0, 25.0, (ROWS, COLUMNS)), 0.0)
    return (50.0 - height) / (rays() @ normal), normal


DRONE = ((0.001, 0.002, 0.003), (0.0, -np.sin(np.radians(60.0)), np.cos(np.radians(60.0))))


@pytest.mark.parametrize('noise_px', [0.0, 0.1])
def test_flat_ground_alone_has_two_answers_and_gives_none(noise_px):
    assert estimate(*tracks(DRONE, noise_px=noise_px, depth=from_above(0.0)[0])) is None


def test_things_on_the_flat_ground_decide():
    depth, normal = from_above(0.2)
    rotation, translation = motion(*DRONE)
    found = estimate(*tracks(DRONE, noise_px=0.1, depth=depth))
    assert degrees_turned(found.rotation, rotation) < 0.05
    assert degrees_between(found.direction, translation) < 1.0
    assert degrees_between(found.ground, rotation @ normal) < 1.0


def test_nothing_in_common_and_too_few_give_none():
    earlier, now = tracks(DRIVES['curve'])
    assert estimate(earlier, np.random.default_rng(0).permutation(now)) is None
    assert estimate(earlier[:30], now[:30]) is None
    assert estimate(earlier[:0], now[:0]) is None


def test_uncalibrated_cameras_take_the_share():
    drive = DRIVES['straight']
    share = CAMERA.fx / CAMERA.width
    found = RelativePoseEstimator(share).estimate(*tracks(drive), CAMERA.width, CAMERA.height, None)
    assert np.hypot(*(found.epipole - [CAMERA.cx, CAMERA.cy])) < 2.0


def test_plane_by_hand():
    """1.5 m under a camera that goes 1 m down and turns upside down about its axis."""
    half_turn = PoseEstimate(np.diag([-1.0, -1.0, 1.0]), np.array([0.0, 1.0, 0.0]), 1.0)
    np.testing.assert_allclose(plane_seen_now(np.array([0.0, 1.0 / 1.5, 0.0]), half_turn), [0.0, -1.0 / 0.5, 0.0])


def sideways(index: int, height: int = 240, width: int = 320) -> np.ndarray:
    """Shelves at four depths, passed sideways: each moves left by a whole number of pixels a frame."""
    picture = np.zeros((height, width), np.uint8)
    for shelf, step in enumerate((1, 3, 6, 10)):
        texture = np.random.default_rng(shelf).integers(0, 256, (12, 120), np.uint8)
        texture = np.kron(texture, np.ones((5, 5), np.uint8))
        picture[60 * shelf:60 * shelf + 60] = texture[:, step * index:step * index + width]
    return picture


def pass_by(**ego_motion) -> EgoMotion:
    config = PipelineConfig(ego_motion=EgoMotionConfig(**ego_motion))
    stage, preprocessor = EgoMotionStage(config), Preprocessor(PreprocessingConfig())
    stage.camera = CameraModel(320, 240, 300.0, 300.0, 159.5, 119.5)
    for index in range(3):
        ego = stage.process(preprocessor.process(sideways(index), (index + 1) * PERIOD_NS))
    return ego


@pytest.mark.parametrize('method', ['indirect', 'flow'])
def test_pictures_to_motion(method):
    camera = pass_by(method=method, relative_pose=True).camera
    assert degrees_between(camera.direction, np.array([-1.0, 0.0, 0.0])) < 5.0
    assert degrees_turned(camera.rotation, np.eye(3)) < 0.3


def test_off_by_default_and_not_for_methods_without_points():
    assert pass_by().camera is None
    with pytest.raises(ConfigError, match='relative_pose: expected ego_motion.method indirect or flow, got direct'):
        EgoMotionConfig(method='direct', relative_pose=True)
