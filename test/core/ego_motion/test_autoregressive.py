"""The autoregressive filter on paths with a known rule."""

from __future__ import annotations

import numpy as np
import pytest

from motion_detect_ros.core.config import EgoMotionConfig
from motion_detect_ros.core.ego_motion.alternatives.autoregressive import ParameterAutoregression
from motion_detect_ros.core.ego_motion.kalman import ParameterKalman
from motion_detect_ros.core.ego_motion.smoothing import make_smoother

DT_S, PERIOD_NS, SIGMA = 0.04, 40_000_000, 0.1
AMPLITUDES = np.array([6.0, 2.0, 0.0, 4.0, 0.0, 1.0])
ELLIPSE_50, ELLIPSE_95 = 5.348, 12.592  # chi-square, six degrees of freedom


def never(_expected: np.ndarray) -> bool:
    """The image never shows what is far from what was expected."""
    return False


def shaking(frames: int, period_frames: float = 7.3) -> np.ndarray:
    """(frames, 6) pixels a frame: a drift, and a sine of its own phase for each parameter."""
    time, phase = np.arange(frames)[:, None], np.arange(6)[None]
    return np.array([1.5, 0, 0, -0.5, 0, 0]) + AMPLITUDES * np.sin(2 * np.pi * time / period_frames + phase)


def noisy(path: np.ndarray, seed: int = 0) -> np.ndarray:
    return path + np.random.default_rng(seed).normal(0, SIGMA, path.shape)


def run(
    smoother, motions: np.ndarray, dt_s: float = DT_S, errors: np.ndarray | None = None,
) -> tuple[np.ndarray, list[np.ndarray], list[bool]]:
    """Filtered motions, covariances, acceptance. After a refused one the next is measured over both frames, and what
    comes out less the other frames' motions; errors: of each measurement.
    """
    out, covariances, accepted, before, frames = [], [], [], np.zeros(6), 1
    for index, values in enumerate(motions):
        measured = before + values + (0.0 if errors is None else errors[index])
        filtered, covariance, known = smoother.update(
            measured, np.eye(6) * SIGMA ** 2, (index + 1) * PERIOD_NS, frames * dt_s, never)
        out.append(filtered - before)
        covariances.append(covariance)
        accepted.append(known)
        before, frames = (np.zeros(6), 1) if known else (before + values, frames + 1)
    return np.array(out), covariances, accepted


def test_a_shaking_camera_is_predicted_better_than_by_its_last_motion():
    path = shaking(150)
    measured, smoother = noisy(path), ParameterAutoregression(EgoMotionConfig())
    errors = []
    for index, values in enumerate(measured):
        forecast = smoother.forecast(DT_S)
        errors.append(np.full(6, np.nan) if forecast is None else forecast - path[index])
        smoother.update(values, np.eye(6) * SIGMA ** 2, (index + 1) * PERIOD_NS, DT_S, never)
    last_value = measured[49:-1] - path[50:]
    moving = AMPLITUDES > 0
    by_rule = np.sqrt(np.mean(np.square(errors[50:]), axis=0))[moving]
    by_last = np.sqrt(np.mean(np.square(last_value), axis=0))[moving]
    assert (by_rule < 0.5 * by_last).all(), (by_rule, by_last)
    assert by_rule.max() < 3 * SIGMA


def test_what_comes_out_is_nearer_the_truth_than_what_was_measured_and_than_kalman_s():
    path = shaking(250)
    measured = noisy(path)
    error = {type(smoother).__name__: np.sqrt(np.mean((run(smoother, measured)[0] - path)[60:] ** 2))
             for smoother in (ParameterAutoregression(EgoMotionConfig()), ParameterKalman(EgoMotionConfig()))}
    assert error['ParameterAutoregression'] < 0.9 * SIGMA
    assert error['ParameterAutoregression'] < 0.95 * error['ParameterKalman']


def test_the_reported_covariance_is_the_spread_of_the_errors():
    distances = []
    for seed in range(6):
        path = shaking(250, 6.0 + seed)
        out, covariances, _ = run(ParameterAutoregression(EgoMotionConfig()), noisy(path, seed))
        distances += [(error @ np.linalg.solve(spread, error))
                      for error, spread in zip((out - path)[60:], covariances[60:], strict=True)]
    assert np.mean(np.array(distances) < ELLIPSE_95) >= 0.9
    assert np.mean(np.array(distances) < ELLIPSE_50) < 0.75


def test_one_wild_estimate_is_refused_a_lasting_change_is_believed():
    path = shaking(150)
    path[120:] += 60.0
    wild = np.zeros_like(path)
    wild[100] = 40.0
    measured = noisy(path)
    out, _, accepted = run(ParameterAutoregression(EgoMotionConfig()), measured, errors=wild)
    assert not accepted[100]
    assert sum(accepted[60:120]) >= 58
    assert accepted[120:123] == [False, False, True]
    np.testing.assert_allclose(out[122:], measured[122:], atol=12)
    assert all(accepted[122:])


def test_reset_and_another_frame_rate_forget_the_rule():
    smoother = ParameterAutoregression(EgoMotionConfig())
    run(smoother, noisy(shaking(60)))
    assert smoother.forecast(DT_S) is not None
    smoother.reset()
    assert smoother.forecast(DT_S) is None
    for dt_s in (0.5 * DT_S, 20 * DT_S):
        run(smoother, noisy(shaking(60)))
        wild = np.full(6, 500.0)
        out, _, accepted = run(smoother, wild[None], dt_s)
        assert accepted == [True]
        np.testing.assert_array_equal(out[0], wild)
    path = shaking(64)
    run(smoother, noisy(path[:60]))
    run(smoother, path[60::2] + path[61::2], 2 * DT_S)
    assert smoother.forecast(DT_S) is None, 'every second frame from now on'


@pytest.mark.parametrize('missing', [1, 2, 3])
def test_frames_that_are_missing_cost_the_rule_nothing(missing: int):
    path = shaking(150)
    measured, smoother = noisy(path), ParameterAutoregression(EgoMotionConfig())
    run(smoother, measured[:100])
    span = slice(100, 101 + missing)
    run(smoother, measured[span].sum(axis=0)[None], (missing + 1) * DT_S)
    errors = [smoother.forecast(DT_S) - path[101 + missing]]
    for index in range(101 + missing, 110):
        run(smoother, measured[index][None])
        errors.append(smoother.forecast(DT_S) - path[index + 1])
    moving = AMPLITUDES > 0
    by_last = np.sqrt(np.mean((measured[49:-1] - path[50:]) ** 2, axis=0))[moving]
    assert (np.sqrt(np.mean(np.square(errors), axis=0))[moving] < 0.6 * by_last).all()


def test_jitter_of_the_stamps_is_no_missing_frame():
    path = shaking(150)
    measured, smoother = noisy(path), ParameterAutoregression(EgoMotionConfig())
    run(smoother, measured[:100])
    for index, share in ((100, 0.7), (101, 1.3)):
        _, _, accepted = run(smoother, share * measured[index][None], share * DT_S)
        assert accepted == [True]
    errors = []
    for index in range(102, 110):
        errors.append(smoother.forecast(DT_S) - path[index])
        run(smoother, measured[index][None])
    moving = AMPLITUDES > 0
    by_last = np.sqrt(np.mean((measured[49:-1] - path[50:]) ** 2, axis=0))[moving]
    assert (np.sqrt(np.mean(np.square(errors), axis=0))[moving] < 0.6 * by_last).all()


def test_another_rate_at_the_start_costs_a_frame():
    smoother, order = ParameterAutoregression(EgoMotionConfig()), EgoMotionConfig().ar_order
    run(smoother, noisy(shaking(1)), 0.5 * DT_S)
    run(smoother, noisy(shaking(order)))
    assert smoother.forecast(DT_S) is not None


def test_a_still_camera_leaves_the_weights_bounded():
    smoother = ParameterAutoregression(EgoMotionConfig(ar_forgetting_s=5 * DT_S))
    out, covariances, accepted = run(smoother, np.zeros((2000, 6)))
    assert np.isfinite(out).all() and np.isfinite(covariances[-1]).all() and all(accepted)
    later, _, _ = run(smoother, noisy(shaking(100)))
    assert np.abs(later[30:] - shaking(100)[30:]).max() < 1.0


def test_hours_of_exactly_no_motion_leave_numbers():
    smoother = ParameterAutoregression(EgoMotionConfig(process_noise_px_per_s2=10.0))
    run(smoother, np.zeros((4000, 6)), 1.0 / 60.0)
    assert np.isfinite(smoother.forecast(1.0 / 60.0)).all()
    later, _, _ = run(smoother, noisy(shaking(100)), 1.0 / 60.0)
    assert np.isfinite(later).all()


@pytest.mark.parametrize('order', [1, 3, 12])
def test_order_is_how_many_measurements_come_first(order):
    smoother = make_smoother(EgoMotionConfig(smoothing='autoregressive', ar_order=order))
    for index, values in enumerate(noisy(shaking(order))):
        assert smoother.forecast(DT_S) is None
        smoother.update(values, np.eye(6) * SIGMA ** 2, (index + 1) * PERIOD_NS, DT_S, never)
    assert smoother.forecast(DT_S).shape == (6,)
