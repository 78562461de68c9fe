"""Families of motions, their matrices, and the robust fit, against formulas written out here."""

from __future__ import annotations

import cv2
import numpy as np
import pytest

from motion_detect_ros.core.ego_motion.robust_fit import fit_motion, refine_motion
from motion_detect_ros.core.errors import ConfigError
from motion_detect_ros.core.geometry.affine import to_centre
from motion_detect_ros.core.geometry.motion_models import (
    FAMILIES,
    displacement,
    jacobian,
    matrix_theta,
    model_family,
    normalised,
    theta_matrix,
)

CENTRE = np.array([320.0, 240.0])
REACH = 400.0  # hypot(320, 240)
#: What each family is: the warps it must reproduce exactly, in pixels about the centre.
LINEAR = {'translation': np.eye(2), 'similarity': np.array([[1.01, -0.02], [0.02, 1.01]]),
          'affine': np.array([[1.02, -0.03], [0.01, 0.98]]), 'homography': np.array([[1.02, -0.03], [0.01, 0.98]])}
SHIFT, PERSPECTIVE = np.array([5.0, -3.0]), np.array([2e-5, -3e-5])


def true_matrix(name: str) -> np.ndarray:
    """x' = centre + ((LINEAR) (x - centre) + SHIFT) / (1 + PERSPECTIVE.(x - centre))."""
    about = np.eye(3)
    about[:2, :2], about[:2, 2] = LINEAR[name], SHIFT
    if name == 'homography':
        about[2, :2] = PERSPECTIVE
    to, back = np.eye(3), np.eye(3)
    to[:2, 2], back[:2, 2] = -CENTRE, CENTRE
    matrix = back @ about @ to
    return matrix / matrix[2, 2]


def bergen(points: np.ndarray, a: np.ndarray) -> np.ndarray:
    """Displacement of Bergen et al. 1992, equation 8, a1..a8, coordinates about the centre, pixels."""
    x, y = (points - CENTRE).T
    return np.column_stack([a[0] + a[1] * x + a[2] * y + a[6] * x * x + a[7] * x * y,
                            a[3] + a[4] * x + a[5] * y + a[6] * x * y + a[7] * y * y])


QUADRATIC = np.array([3.0, 0.01, -0.02, -2.0, 0.015, 0.005, 1e-5, -2e-5])


def scattered(count: int = 600, seed: int = 0) -> np.ndarray:
    return np.random.default_rng(seed).uniform([0, 0], [640, 480], (count, 2)).astype(np.float32)


def moved_by(name: str, points: np.ndarray) -> np.ndarray:
    if name == 'quadratic':
        return (points + bergen(points, QUADRATIC)).astype(np.float32)
    return cv2.perspectiveTransform(points[None], true_matrix(name))[0]


def with_outliers(moved: np.ndarray, share: float, seed: int = 1) -> np.ndarray:
    random = np.random.default_rng(seed)
    out = moved + random.normal(0, 0.1, moved.shape).astype(np.float32)
    count = round(share * len(out))
    out[:count] += random.uniform(4, 20, (count, 2)).astype(np.float32)
    return out


@pytest.mark.parametrize('name', FAMILIES)
def test_the_fit_finds_its_own_kind_of_motion_under_outliers(name):
    points = scattered()
    fit = fit_motion(model_family(name), points, with_outliers(moved_by(name, points), 0.3), 1.0, CENTRE)
    assert not fit.inliers[:180].any() and fit.inliers[180:].mean() > 0.97
    check = scattered(50, 7)
    predicted = check + displacement(model_family(name), fit.theta, normalised(check, CENTRE), CENTRE)
    assert np.abs(predicted - moved_by(name, check)).max() < 0.1
    assert fit.residual_px == pytest.approx(0.1 * 1.1774, rel=0.1)  # median of a Rayleigh distribution
    if name != 'quadratic':
        by_matrix = cv2.perspectiveTransform(check[None], theta_matrix(fit.theta, CENTRE))[0]
        np.testing.assert_allclose(by_matrix, predicted, atol=1e-3)


def test_a_translation_starts_from_all_that_agree_not_from_one_of_them():
    """One point of 600 is off by less than the threshold, and the first: its displacement is no start."""
    points = scattered()
    moved = moved_by('translation', points) + np.random.default_rng(2).normal(0, 0.02, points.shape).astype(np.float32)
    moved[0] += 0.5
    fit = fit_motion(model_family('translation'), points, moved, 1.0, CENTRE)
    np.testing.assert_allclose(fit.theta[[0, 3]], SHIFT, atol=0.01)
    assert fit.inliers[1:].mean() > 0.97 and not fit.inliers[0]


@pytest.mark.parametrize(('smaller', 'larger'), [
    ('translation', 'similarity'), ('similarity', 'affine'), ('affine', 'homography'), ('affine', 'quadratic')])
def test_a_smaller_family_cannot_follow_what_the_larger_one_can(smaller, larger):
    points = scattered()
    moved = moved_by(larger, points)
    fits = [fit_motion(model_family(name), points, moved, 3.0, CENTRE) for name in (smaller, larger)]
    assert fits[0].residual_px > 20 * fits[1].residual_px
    assert fits[1].residual_px < 0.01


def test_the_quadratic_s_parameters_are_bergen_s():
    points = scattered()
    fit = fit_motion(model_family('quadratic'), points, moved_by('quadratic', points), 1.0, CENTRE)
    scale = np.array([1, REACH, REACH, 1, REACH, REACH, -REACH ** 2, -REACH ** 2])
    np.testing.assert_allclose(fit.theta, QUADRATIC * scale, atol=2e-3)


def test_the_quadratic_s_homography_agrees_to_first_order():
    """Half the motion, a quarter of the difference; at the centre none, of value nor slope."""
    def difference(share: float, points: np.ndarray) -> np.ndarray:
        a = share * QUADRATIC
        theta = a * np.array([1, REACH, REACH, 1, REACH, REACH, -REACH ** 2, -REACH ** 2])
        by_matrix = cv2.perspectiveTransform(points[None], theta_matrix(theta, CENTRE))[0]
        return np.linalg.norm(by_matrix - points - bergen(points, a), axis=1)
    corners = np.array([[0, 0], [640, 0], [0, 480], [640, 480]], float)
    whole, half = difference(1.0, corners).max(), difference(0.5, corners).max()
    assert 0.01 < whole < 0.3
    assert whole / half == pytest.approx(4.0, rel=0.1)
    near = CENTRE + np.array([[0, 0], [1, 0], [0, 1]], float)
    assert difference(1.0, near).max() < 1e-6


def test_theta_and_matrix_are_two_forms_of_one_thing():
    matrix = true_matrix('homography')
    theta = matrix_theta(matrix, CENTRE)
    np.testing.assert_allclose(theta_matrix(theta, CENTRE), matrix, atol=1e-12)
    # the affine part: value and slope of the warp at the centre, by differences
    step = 1e-3
    near = CENTRE + step * np.array([[0, 0], [1, 0], [0, 1]])
    at = cv2.perspectiveTransform(near[None], matrix)[0] - CENTRE
    np.testing.assert_allclose(theta[[0, 3]], at[0], atol=1e-9)
    slopes = np.column_stack([at[1] - at[0], at[2] - at[0]]) / step - np.eye(2)
    np.testing.assert_allclose(theta[[[1, 2], [4, 5]]] / REACH, slopes, atol=1e-6)


@pytest.mark.parametrize('name', ['homography', 'quadratic'])
def test_the_derivative_is_the_slope_of_the_displacement(name):
    family, x = model_family(name), normalised(scattered(20), CENTRE)
    theta = matrix_theta(true_matrix('homography'), CENTRE)
    numeric = np.stack([
        (displacement(family, theta + h, x, CENTRE) - displacement(family, theta - h, x, CENTRE)) / 2e-4
        for h in 1e-4 * np.eye(8)], axis=-1)
    np.testing.assert_allclose(jacobian(family, theta, x, CENTRE), numeric, atol=1e-6)


@pytest.mark.parametrize('name', FAMILIES)
def test_the_covariance_is_the_spread_of_repeated_fits(name):
    """Mean squared Mahalanobis distance of the free parameters = their number (chi-square), over 150 noisy copies."""
    family, points, moved = model_family(name), scattered(200), moved_by(name, scattered(200))
    truth = fit_motion(family, points, moved, 1.0, CENTRE).theta
    random, distances = np.random.default_rng(3), []
    for _ in range(150):
        fit = refine_motion(family, points, moved + random.normal(0, 0.2, moved.shape), truth, CENTRE)
        error = fit.theta - truth
        distances.append(error @ np.linalg.pinv(fit.covariance, rcond=1e-9) @ error)
    freedom = family.basis.shape[1]
    assert np.mean(distances) == pytest.approx(freedom, rel=0.3)


@pytest.mark.parametrize('name', ['affine', 'homography'])
def test_points_on_a_line_determine_nothing(name):
    points = scattered()
    points[:, 1] = 100.0 + 0.5 * points[:, 0]
    fit = refine_motion(model_family(name), points, points + np.float32(2.0), np.zeros(8), CENTRE)
    assert fit is None


def test_unknown_models_are_named():
    with pytest.raises(ConfigError, match='ego_motion.model: expected one of translation, .*quadratic, got .cubic.'):
        model_family('cubic')


def test_centred_parameters_are_displacements_at_the_centre_and_at_the_corner_distance():
    # dx = 5 + 0.01 x - 0.02 y at (320, 240): 5 + 3.2 - 4.8 = 3.4; slopes times hypot(320, 240) = 400
    params = np.array([5.0, 0.01, -0.02, 1.0, 0.005, 0.0])
    np.testing.assert_allclose(to_centre(CENTRE) @ params, [3.4, 4.0, -8.0, 2.6, 2.0, 0.0])
