"""Camera motion and epipolar half-lines against scenes whose geometry is exact."""

from __future__ import annotations

import cv2
import numpy as np
import pytest
from street import CAMERA, flow, motion, pixels, street_depth

from motion_detect_ros.core.geometry import epipolar
from motion_detect_ros.core.geometry.epipolar import PoseEstimate, epipolar_lines, estimate_pose, normalised

DRIVES = {
    'straight': ((0.0, 0.0, 0.0), (0.0, 0.0, 1.0)),
    'curve': ((0.002, 0.03, -0.001), (0.1, 0.02, 1.2)),
    'sideways': ((0.0, 0.01, 0.0), (0.8, 0.0, 0.1)),
    'backwards': ((0.0, -0.01, 0.0), (0.0, 0.0, -0.7)),
}


def _seen(drive: str, noise_px: float = 0.0, outliers: float = 0.0):
    rotation, translation = motion(*DRIVES[drive])
    now = pixels()
    earlier = now - flow(street_depth(), rotation, translation)
    random = np.random.default_rng(3)
    earlier += random.normal(0.0, noise_px, earlier.shape)
    wrong = random.random(earlier.shape[:2]) < outliers
    earlier[wrong] += random.uniform(-20, 20, (int(wrong.sum()), 2))
    return normalised(earlier, CAMERA).reshape(-1, 2), normalised(now, CAMERA).reshape(-1, 2), rotation, translation


def _estimate(earlier: np.ndarray, now: np.ndarray, start: PoseEstimate | None = None) -> PoseEstimate | None:
    return estimate_pose(earlier, now, np.ones(len(earlier), bool), CAMERA.fx, start)


def _turn_error_deg(a: np.ndarray, b: np.ndarray) -> float:
    return float(np.degrees(np.arccos(np.clip((np.trace(a.T @ b) - 1.0) / 2.0, -1.0, 1.0))))


def _direction_error_deg(found: PoseEstimate, translation: np.ndarray) -> float:
    return float(np.degrees(np.arccos(np.clip(found.direction @ translation / np.linalg.norm(translation), -1, 1))))


@pytest.mark.parametrize('drive', DRIVES)
def test_motion_is_exact_on_exact_points(drive: str):
    earlier, now, rotation, translation = _seen(drive)
    found = _estimate(earlier, now)
    assert _turn_error_deg(found.rotation, rotation) < 0.01
    assert _direction_error_deg(found, translation) < 0.2
    assert found.inlier_share > 0.99


@pytest.mark.parametrize('drive', DRIVES)
def test_motion_survives_noise_and_a_quarter_of_outliers(drive: str):
    earlier, now, rotation, translation = _seen(drive, noise_px=0.2, outliers=0.25)
    found = _estimate(earlier, now)
    assert _turn_error_deg(found.rotation, rotation) < 0.1
    assert _direction_error_deg(found, translation) < 3.0
    assert 0.6 < found.inlier_share < 0.95


def test_motion_of_the_frame_before_is_a_good_start():
    earlier, now, rotation, translation = _seen('curve', noise_px=0.2)
    before = PoseEstimate(*motion((0.0, 0.028, 0.0), (0.0, 0.0, -1.0)), 0.9)
    before = PoseEstimate(before.rotation, before.direction / np.linalg.norm(before.direction), 0.9)
    found = _estimate(earlier, now, before)
    assert _turn_error_deg(found.rotation, rotation) < 0.1
    assert _direction_error_deg(found, translation) < 3.0


def test_wrong_start_is_not_kept():
    earlier, now, rotation, _ = _seen('curve')
    wrong = PoseEstimate(motion((0.3, -0.4, 0.2), (0.0, 0.0, 1.0))[0], np.array([1.0, 0.0, 0.0]), 0.9)
    assert _turn_error_deg(_estimate(earlier, now, wrong).rotation, rotation) < 0.05


@pytest.mark.parametrize('drive', DRIVES)
def test_derivative_of_the_line_distance_is_that_of_differences(drive: str):
    earlier, now, rotation, translation = _seen(drive, noise_px=2.0)
    direction = translation / np.linalg.norm(translation)
    tilts = epipolar._tilts(direction)
    assert np.allclose(np.vstack([direction, tilts]) @ np.vstack([direction, tilts]).T, np.eye(3), atol=1e-12)

    def distance(step: np.ndarray) -> np.ndarray:
        """By the definition: from the point to its line."""
        tilted = direction + step[3:] @ tilts
        lines = epipolar_lines(earlier, PoseEstimate(cv2.Rodrigues(step[:3])[0] @ rotation, tilted, 1.0))
        away, along = now - lines.far, lines.towards
        return (away[:, 0] * along[:, 1] - away[:, 1] * along[:, 0]) / np.sqrt((along ** 2).sum(axis=1) + 1e-6)

    found, slope = np.empty(len(now)), np.empty((len(now), 5))
    epipolar._linearise(earlier, now, rotation, direction, tilts, found, slope)
    assert np.allclose(found, distance(np.zeros(5)), atol=1e-12)
    small = 1e-6 * np.eye(5)
    differences = np.array([(distance(step) - distance(-step)) / 2e-6 for step in small])
    assert np.allclose(slope.T, differences, atol=1e-5 * np.abs(differences).max())


@pytest.mark.parametrize('count', [60, 301])
@pytest.mark.parametrize('least_sigma', [1e-6, 0.8])
def test_step_is_that_of_weighted_least_squares(count: int, least_sigma: float):
    random = np.random.default_rng(5)
    slope, distance = random.normal(size=(count, 5)), random.normal(size=count)
    distance[::9] *= 20.0
    sigma = max(least_sigma, 1.4826 * float(np.median(np.abs(distance))))
    root = np.clip(1.0 - (distance / (4.685 * sigma)) ** 2, 0.0, None)  # of the weight
    expected = -np.linalg.lstsq(slope * root[:, None], distance * root, rcond=None)[0]
    np.testing.assert_allclose(epipolar._step(distance, slope, least_sigma), expected, rtol=1e-6)


def test_too_few_points_give_no_motion():
    earlier, now, _, _ = _seen('straight')
    assert _estimate(earlier[:20], now[:20]) is None


@pytest.mark.parametrize('reach', [0.0, 0.5], ids=['one place', 'a line'])
def test_points_that_determine_no_essential_matrix_give_no_motion(reach: float):
    """OpenCV finds none for a hundred points in one place or on one line that do not move."""
    still = np.stack([np.linspace(-reach, reach, 100), np.zeros(100)], axis=1)
    assert _estimate(still, still) is None


def test_points_that_are_not_known_do_not_count():
    earlier, now, rotation, _ = _seen('curve')
    known = np.arange(len(earlier)) % 3 == 0
    wrong = np.where(known[:, None], earlier, 0.3)
    assert _turn_error_deg(estimate_pose(wrong, now, known, CAMERA.fx).rotation, rotation) < 0.01


def test_inverse_depth_is_that_of_the_scene():
    rotation, translation = motion(*DRIVES['curve'])
    depth_now = street_depth()
    now = normalised(pixels(), CAMERA)
    earlier = normalised(pixels() - flow(depth_now, rotation, translation), CAMERA)
    step = float(np.linalg.norm(translation))
    lines = epipolar_lines(earlier, PoseEstimate(rotation, translation / step, 1.0))
    s = lines.position(now)
    assert np.allclose(lines.far + s[..., None] * lines.towards, now, atol=1e-4)
    # depth in the earlier camera, by hand: z of R^T (X - t)
    x_now = np.dstack([now, np.ones(now.shape[:2])]) * depth_now[..., None]
    depth_earlier = ((x_now - translation) @ rotation)[..., 2]
    assert np.allclose(lines.inverse_depth(s), step / depth_earlier, rtol=2e-2, atol=1e-4)


@pytest.mark.parametrize('swapped', [False, True])
@pytest.mark.parametrize('drive', DRIVES)
def test_the_camera_does_not_turn_upside_down(drive: str, swapped: bool, monkeypatch: pytest.MonkeyPatch):
    """Of the two turns of an essential matrix OpenCV may name either first."""
    earlier, now, rotation, _ = _seen(drive)
    decomposed = cv2.decomposeEssentialMat

    def either(essential: np.ndarray) -> tuple[np.ndarray, ...]:
        one, other, direction = decomposed(essential)
        return (other, one, direction) if swapped else (one, other, direction)

    monkeypatch.setattr(cv2, 'decomposeEssentialMat', either)
    assert _turn_error_deg(epipolar._ransac(earlier, now, CAMERA.fx).rotation, rotation) < 1.0
