"""Weights of the robust fit against plain NumPy."""

from __future__ import annotations

import numpy as np
import pytest

from motion_detect_ros.core.ego_motion.robust_fit import _weigh


@pytest.mark.parametrize(('count', 'least'), [(41, 0.02), (40, 0.02), (41, 5.0)])
def test_weights_are_tukey_s_by_the_median_deviation_of_both_components(count: int, least: float) -> None:
    random = np.random.default_rng(count)
    errors = random.normal([[0.3], [-0.2]], 0.5, (2, count))
    errors[:, ::6] += 9.0
    weights = np.empty(count)
    _weigh(errors, least, np.empty(2 * count), weights)
    middle = np.sort(errors, axis=1)[:, count // 2, None]
    sigma = max(1.4826 * np.sort(np.abs(errors - middle).ravel())[count], least)
    share = 1.0 - (errors ** 2).sum(axis=0) / (4.685 * sigma) ** 2
    np.testing.assert_allclose(weights, np.where(share > 0.0, share, 0.0) ** 2, atol=1e-12)
