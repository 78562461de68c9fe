"""The parameter filter against a textbook filter written out here, and against what smoothing must do."""

from __future__ import annotations

import numpy as np
import pytest

from motion_detect_ros.core.config import EgoMotionConfig
from motion_detect_ros.core.ego_motion.kalman import ParameterKalman

DT_S, PERIOD_NS = 0.04, 40_000_000


def never(_expected: np.ndarray) -> bool:
    """The image never shows what is far from what was expected."""
    return False


def test_agrees_with_a_filter_written_out_for_one_parameter():
    spread = 50.0
    smoother = ParameterKalman(EgoMotionConfig(process_noise_px_per_s2=spread))
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
        params, _, accepted = smoother.update(centred, np.eye(6) * noise, (index + 1) * PERIOD_NS, DT_S, never)
        assert accepted
        got.append(params[0])
    np.testing.assert_allclose(got, expected, rtol=1e-9)


def filtered(values: list[float], sigma: float, spread: float) -> tuple[np.ndarray, list[bool], list[float]]:
    smoother = ParameterKalman(EgoMotionConfig(process_noise_px_per_s2=spread))
    out, accepted, variances = [], [], []
    for index, value in enumerate(values):
        params, covariance, ok = smoother.update(
            np.array([value, 0, 0, 0, 0, 0]), np.eye(6) * sigma ** 2, (index + 1) * PERIOD_NS, DT_S, never)
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


#: Chi-square with six degrees of freedom: the ellipses that hold half and 95 % of a Gaussian (tables).
ELLIPSE_50, ELLIPSE_95 = 5.348, 12.592


def squared_distances(path: str, trials: int = 500, frames: int = 15, spread: float = 30.0) -> np.ndarray:
    """Squared Mahalanobis distances of the filtered parameters from the true ones, at the end of every trial.

    path: ``wiener``, an acceleration that changes by a random step each frame; ``white``, one drawn anew each frame;
    ``steady``, none.
    """
    random, found = np.random.default_rng(7), []
    mixed = random.normal(size=(6, 6))
    noise = 0.05 ** 2 * (mixed @ mixed.T / 6 + 0.2 * np.eye(6))  # correlated, about 0.05 px
    for _ in range(trials):
        smoother = ParameterKalman(EgoMotionConfig(process_noise_px_per_s2=spread))
        rate, acceleration = random.normal(0, 200, 6), random.normal(0, spread, 6)
        for index in range(frames):
            true = rate * DT_S
            measured = random.multivariate_normal(true, noise)
            params, covariance, accepted = smoother.update(measured, noise, (index + 1) * PERIOD_NS, DT_S, never)
            step = random.normal(0, spread, 6)
            acceleration = {'wiener': acceleration + step, 'white': step, 'steady': 0 * step}[path]
            rate = rate + acceleration * DT_S
        if accepted:  # of the 0.1 % beyond the gate there is no estimate
            found.append((params - true) @ np.linalg.solve(covariance, params - true))
    assert len(found) > 0.98 * trials
    return np.array(found)


def test_the_reported_covariance_is_the_spread_of_the_errors():
    """The mean of 500 distances with six degrees of freedom has a deviation of sqrt(12 / 500) = 0.15."""
    distances = squared_distances('wiener')
    assert 0.92 < np.mean(distances < ELLIPSE_95) < 0.98
    assert 0.43 < np.mean(distances < ELLIPSE_50) < 0.57
    assert np.mean(distances) == pytest.approx(6.0, abs=0.6)


@pytest.mark.parametrize('path', ['white', 'steady'])
def test_paths_other_than_the_model_s_stay_inside_without_making_it_absurdly_wide(path):
    distances = squared_distances(path)
    assert np.mean(distances < ELLIPSE_95) >= 0.9
    assert np.mean(distances < ELLIPSE_50) < 0.75
