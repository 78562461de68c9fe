"""The filter of three numbers against the textbook's with matrices of 4 x 4."""

from __future__ import annotations

import numpy as np
import pytest

from motion_detect_ros.core.tracking.motion_filter import FIRST_VELOCITY_RATIO, VELOCITY_RATIO, MotionFilter
from motion_detect_ros.core.tracking.track import AT_REST

PLACE_OF_STATE = np.eye(2, 4)


class Textbook:
    """x = F x, P = F P F' + G G' q; S = H P H' + R, K = P H' S^-1, x += K y, P = (1 - K H) P."""

    def __init__(self, state: np.ndarray, noise: float) -> None:
        self.x = state
        self.P = np.diag([noise, noise, FIRST_VELOCITY_RATIO * noise, FIRST_VELOCITY_RATIO * noise])

    def predict(self, dt: float, acceleration: float) -> None:
        F, G = np.eye(4), np.array([[dt ** 2 / 2, 0], [0, dt ** 2 / 2], [dt, 0], [0, dt]])
        F[0, 2] = F[1, 3] = dt
        self.x = F @ self.x
        self.P = F @ self.P @ F.T + G @ G.T * acceleration ** 2

    def correct(self, H: np.ndarray, R: np.ndarray, measured: np.ndarray) -> float:
        y, S = measured - H @ self.x, H @ self.P @ H.T + R
        K = self.P @ H.T @ np.linalg.inv(S)
        self.x, self.P = self.x + K @ y, (np.eye(4) - K @ H) @ self.P
        return float(y @ np.linalg.inv(S) @ y)


@pytest.mark.parametrize('seed', range(5))
def test_states_and_variances_are_the_textbook_s(seed: int) -> None:
    random = np.random.default_rng(seed)
    first = random.normal(0.0, 50.0, 4)
    ours, theirs = MotionFilter(tuple(first[:2].tolist()), tuple(first[2:].tolist()), 2.0), Textbook(first.copy(), 2.0)
    normalised = []
    for _ in range(40):
        dt, acceleration, noise = random.uniform(0.02, 0.1), random.uniform(5, 50), random.uniform(0.5, 20.0)
        ours.predict(AT_REST, dt, acceleration)
        theirs.predict(dt, acceleration)
        choice = random.integers(4)
        measured = theirs.x + random.normal(0.0, 3.0, 4)
        if choice == 0:
            ours.correct_place(measured[:2], noise)
            theirs.correct(PLACE_OF_STATE, noise * np.eye(2), measured[:2])
        elif choice == 1:
            ours.widen(noise)
            theirs.P[:2, :2] += noise * np.eye(2)
        else:
            ours.correct(measured[:2], measured[2:], noise)
            spread = np.diag([noise, noise, VELOCITY_RATIO * noise, VELOCITY_RATIO * noise])
            normalised.append(theirs.correct(np.eye(4), spread, measured) / 4.0)
        assert [*ours.centre, *ours.velocity] == pytest.approx(theirs.x, rel=1e-9)
        assert [ours._place, ours._both, ours._speed] == pytest.approx(theirs.P[[0, 0, 2], [0, 2, 2]], rel=1e-7)
    scale, weight = 1.0, 5.0  # running mean of the normalised innovations: 0.9 kept an update, from 1 of weight 5
    for each in normalised:
        scale, weight = (0.9 * weight * scale + each) / (0.9 * weight + 1.0), 0.9 * weight + 1.0
    assert ours._spread._scale == pytest.approx(scale, rel=1e-6)


def test_the_camera_carries_the_position_in_pixel_centres() -> None:
    """Twice as large about the centre of pixel (0, 0), which is (0.5, 0.5) in edges of pixels."""
    track = MotionFilter((10.5, 20.5), (30.0, 0.0), 1.0)
    track.predict(np.diag([2.0, 2.0, 1.0]).tolist(), 0.1, 0.0)
    assert [*track.centre, *track.velocity] == pytest.approx([20.5 + 6.0, 40.5, 60.0, 0.0])


def test_what_is_measured_along_one_axis_says_nothing_of_the_other() -> None:
    """A flow that is 10 px/s off adds 1.25 x 10^2 (px/s)^2 to the variance along it.

    With the axes exchanged, so are states and variances.
    """
    def corrected(*lags: tuple[float, float]) -> MotionFilter:
        track = MotionFilter((100.0, 100.0), (0.0, 0.0), 2.0)
        for lag_u, lag_v in lags:
            track.predict(AT_REST, 0.04, 20.0)
            (u, v), (du, dv) = track.centre, track.velocity
            track.correct((u + 0.1 * lag_u, v + 0.1 * lag_v), (du + lag_u, dv + lag_v), 2.0)
        return track

    across, down = corrected((10.0, 0.0)).velocity_variance, corrected((0.0, 10.0)).velocity_variance
    assert across[0] - across[1] == pytest.approx(125.0)
    assert down == pytest.approx(across[::-1])
    lags = [(8.0, -3.0), (5.0, 1.0), (-2.0, 6.0), (1.0, 4.0)]
    one, other = corrected(*lags), corrected(*(each[::-1] for each in lags))
    assert other.velocity_variance == pytest.approx(one.velocity_variance[::-1])
    assert (other.centre, other.velocity) == (pytest.approx(one.centre[::-1]), pytest.approx(one.velocity[::-1]))
