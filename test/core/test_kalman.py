"""The parameter filter against a textbook filter written out here, and against what smoothing must do."""

from __future__ import annotations

import numpy as np
import pytest

from motion_detect_ros.core.affine import affine_matrix, affine_params, refine_affine
from motion_detect_ros.core.config import EgoMotionConfig
from motion_detect_ros.core.kalman import ParameterKalman, to_centre

CENTRE = np.array([320.0, 240.0])
DT_S, PERIOD_NS = 0.04, 40_000_000


def test_centred_parameters_are_displacements_at_the_centre_and_at_the_corner_distance():
    # dx = 5 + 0.01 x - 0.02 y at (320, 240): 5 + 3.2 - 4.8 = 3.4; slopes times hypot(320, 240) = 400
    params = np.array([5.0, 0.01, -0.02, 1.0, 0.005, 0.0])
    np.testing.assert_allclose(to_centre(CENTRE) @ params, [3.4, 4.0, -8.0, 2.6, 2.0, 0.0])


def test_agrees_with_a_filter_written_out_for_one_parameter():
    spread = 50.0
    smoother = ParameterKalman(EgoMotionConfig(process_noise_px_per_s2=spread))
    back = np.linalg.inv(to_centre(CENTRE))
    measured = [2.0, 2.3, 1.9, 2.1, 2.6]  # px a frame at the image centre
    noise = 0.25
    # textbook, one dimension: state (velocity, acceleration), F = [[1, dt], [0, 1]], Q = s^2 [dt, 1][dt, 1]^T
    z0, r = measured[0] / DT_S, noise / DT_S ** 2
    x, p = np.array([z0, 0.0]), np.diag([r, spread ** 2])
    expected = [measured[0]]
    f, g = np.array([[1.0, DT_S], [0.0, 1.0]]), np.array([DT_S, 1.0]) * spread
    for z in measured[1:]:
        x, p = f @ x, f @ p @ f.T + np.outer(g, g)
        k = p[:, 0] / (p[0, 0] + r)
        x, p = x + k * (z / DT_S - x[0]), p - np.outer(k, p[0])
        expected.append(x[0] * DT_S)
    got = []
    for index, value in enumerate(measured):
        centred = np.array([value, 0, 0, 0, 0, 0])
        covariance = back @ (np.eye(6) * noise) @ back.T
        params, _, accepted = smoother.update(back @ centred, covariance, (index + 1) * PERIOD_NS, DT_S, CENTRE)
        assert accepted
        got.append((to_centre(CENTRE) @ params)[0])
    np.testing.assert_allclose(got, expected, rtol=1e-9)


def filtered(values: list[float], sigma: float, spread: float) -> tuple[np.ndarray, list[bool], list[float]]:
    smoother = ParameterKalman(EgoMotionConfig(process_noise_px_per_s2=spread))
    out, accepted, variances = [], [], []
    for index, value in enumerate(values):
        params, covariance, ok = smoother.update(
            np.array([value, 0, 0, 0, 0, 0]), np.eye(6) * sigma ** 2, (index + 1) * PERIOD_NS, DT_S,
            np.array([0.6, 0.8]))
        out.append(params[0])
        accepted.append(ok)
        variances.append(covariance[0, 0])
    return np.array(out), accepted, variances


def test_steady_motion_comes_out_smoother_and_surer_than_measured():
    random = np.random.default_rng(1)
    noisy = 3.0 + random.normal(0, 0.3, 300)
    smooth, accepted, variances = filtered(noisy.tolist(), 0.3, 1.0)
    assert np.std(smooth[50:] - 3.0) < 0.5 * 0.3
    assert variances[-1] < 0.25 * variances[0]
    assert np.mean(accepted) > 0.98


def test_one_wild_estimate_is_refused_a_lasting_change_is_believed():
    values = [2.0] * 10 + [60.0] + [2.0] * 10 + [40.0] * 10
    smooth, accepted, _ = filtered(values, 0.05, 20.0)
    assert not accepted[10]
    assert all(accepted[:10]) and all(accepted[11:21])
    assert accepted[21:24] == [False, False, True]
    assert smooth[-1] == pytest.approx(40.0, abs=0.1)


def test_affine_parameters_and_matrix_are_two_forms_of_one_thing():
    params = np.array([1.0, 0.1, 0.2, -2.0, 0.3, 0.4])
    # x' = x + 1 + 0.1 x + 0.2 y and y' = y - 2 + 0.3 x + 0.4 y at (10, 20): 10 + 1 + 1 + 4 = 16, 20 - 2 + 3 + 8 = 29
    np.testing.assert_allclose(affine_matrix(params) @ [10, 20, 1], [16, 29, 1])
    np.testing.assert_allclose(affine_params(affine_matrix(params)), params)


def test_robust_fit_ignores_outliers_and_tells_its_spread():
    random = np.random.default_rng(2)
    true = np.array([2.0, 0.01, -0.02, -1.0, 0.015, 0.005])
    points = random.uniform(0, 600, (800, 2))
    design = np.column_stack([np.ones(800), points])
    moved = points + design @ true.reshape(2, 3).T + random.normal(0, 0.2, (800, 2))
    moved[:200] += random.uniform(5, 20, (200, 2))
    fit = refine_affine(points, moved, true + np.array([0.5, 0, 0, -0.5, 0, 0]))
    corners = np.array([[1, 0, 0], [1, 600, 600]])
    np.testing.assert_allclose(corners @ fit.params.reshape(2, 3).T, corners @ true.reshape(2, 3).T, atol=0.1)
    assert not fit.inliers[:200].any()
    # an ordinary least-squares fit to the 600 good points has this covariance (Gauss-Markov)
    ideal = 0.04 * np.linalg.inv(design[200:].T @ design[200:])
    np.testing.assert_allclose(np.diag(fit.covariance)[:3], np.diag(ideal), rtol=0.35)
