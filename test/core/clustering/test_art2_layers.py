"""The ten stages of classic ART2, each against numbers worked by hand (arithmetic in the comments)."""

from __future__ import annotations

import numpy as np
import pytest

from motion_detect_ros.core.clustering.alternatives import art2_layers as layers
from motion_detect_ros.core.clustering.alternatives.art2_layers import NO_NEURON, F1Constants, P, Q, U, V, W, X

#: Fausett's a, b, c, d; nothing added to the norms.
K = F1Constants(a=10.0, b=10.0, c=0.1, d=0.9, e=0.0, theta=0.1)
S = np.array([0.8, 0.6], np.float32)
#: Background, then weights of length 10 along (0.6, 0.8) and (1, 0), and opposite to S.
NEURONS = np.array([[0, 0], [6, 8], [10, 0], [-8, -6]], np.float32)


def f1_with(**rows) -> np.ndarray:
    f1 = np.zeros((6, 2), np.float32)
    for name, value in rows.items():
        f1[getattr(layers, name)] = value
    return f1


def close(actual, expected) -> None:
    np.testing.assert_allclose(actual, expected, atol=2e-5)


def test_stage_1_w():
    f1 = f1_with(U=(0.8, 0.6))
    layers.layer_w(S, K, f1)
    close(f1[W], (8.8, 6.6))  # 0.8 + 10 * 0.8, 0.6 + 10 * 0.6


def test_stage_2_x():
    f1 = f1_with(W=(8.8, 6.6))
    layers.layer_x(K, f1)
    close(f1[X], (0.8, 0.6))  # |w| = sqrt(77.44 + 43.56) = 11
    layers.layer_x(K._replace(e=1.0), f1)
    close(f1[X], (0.73333, 0.55))  # over 12


def test_stage_3_v():
    f1 = f1_with(X=(0.8, -0.05), Q=(0.05, -0.6))
    layers.layer_v(K, f1)
    close(f1[V], (0.8, -6.0))  # -0.05 and 0.05 are under theta: 0.8 + 10 * 0, 0 + 10 * -0.6


@pytest.mark.parametrize(('y', 'answer'), [(0.8, 0.8), (-0.8, -0.8), (0.1, 0.0), (-0.1, 0.0), (0.05, 0.0), (0.0, 0.0)])
def test_activation_is_odd_and_suppresses_up_to_theta(y, answer):
    assert layers.activation(y, 0.1) == answer


def test_stage_4_u():
    f1 = f1_with(V=(0.0, -6.0))
    layers.layer_u(K, f1)
    close(f1[U], (0.0, -1.0))
    layers.layer_u(K, f1_with())  # zero over zero stays zero
    f1 = f1_with(U=(1.0, 1.0))
    layers.layer_u(K, f1)
    close(f1[U], (0.0, 0.0))


def test_stage_5_p():
    f1 = f1_with(U=(0.8, 0.6))
    layers.layer_p(NEURONS, 1, K, f1)
    close(f1[P], (6.2, 7.8))  # 0.8 + 0.9 * 6, 0.6 + 0.9 * 8
    layers.layer_p(NEURONS, NO_NEURON, K, f1)
    close(f1[P], (0.8, 0.6))


def test_stage_6_q():
    f1 = f1_with(P=(-6.4, -4.8))
    layers.layer_q(K, f1)
    close(f1[Q], (-0.8, -0.6))  # |p| = 8


def test_stage_7_competition():
    # y = 6 * 0.8 + 8 * 0.6 = 9.6;  10 * 0.8 = 8;  -8 * 0.8 - 6 * 0.6 = -10; the background does not compete
    reset = np.zeros(4, np.bool_)
    assert layers.competition(S, NEURONS, reset) == 1
    reset[1] = True
    assert layers.competition(S, NEURONS, reset) == 2
    reset[2] = True
    assert layers.competition(S, NEURONS, reset) == 3
    reset[3] = True
    assert layers.competition(S, NEURONS, reset) == NO_NEURON


@pytest.mark.parametrize(('neuron', 'match'), [
    # u + c p = (0.8 + 0.62, 0.6 + 0.78) = (1.42, 1.38), length sqrt(2.0164 + 1.9044) = 1.980101;
    # |p| = sqrt(6.2^2 + 7.8^2) = sqrt(99.28) = 9.963935; 1.980101 / (1 + 0.9963935)
    (1, 0.991839),
    # p = (9.8, 0.6), length sqrt(96.4) = 9.818350; u + c p = (1.78, 0.66), length sqrt(3.604) = 1.898420;
    # 1.898420 / 1.981835
    (2, 0.957910),
    # p = (0.8 - 7.2, 0.6 - 5.4) = (-6.4, -4.8), length 8; u + c p = (0.16, 0.12), length 0.2; 0.2 / 1.8
    (3, 0.111111),
    # p = u: (1.1 u) over 1 + 0.1
    (NO_NEURON, 1.0),
])
def test_stage_8_reset(neuron, match):
    f1 = f1_with(U=(0.8, 0.6))
    layers.layer_p(NEURONS, neuron, K, f1)
    assert layers.reset_match(K, f1) == pytest.approx(match, abs=1e-6)


def test_stage_8_counts_e():
    # over e + 1 + 0.9963935
    f1 = f1_with(U=(0.8, 0.6), P=(6.2, 7.8))
    assert layers.reset_match(K._replace(e=0.1), f1) == pytest.approx(1.980101 / 2.0963935, abs=1e-6)


def test_stage_9_commitment():
    close(layers.commitment(S, K), (8.0, 6.0))  # 0.8 / 0.1, 0.6 / 0.1


def test_stage_10_learning():
    # alpha = 0.6: alpha d = 0.54, 1 + alpha d (d - 1) = 0.946:
    # 0.54 * 0.8 + 0.946 * 6 = 6.108;  0.54 * 0.6 + 0.946 * 8 = 7.892; the larger change is 0.108 (both are)
    neurons = NEURONS.copy()
    changed = layers.learning(neurons, 1, 0.6, K, f1_with(U=(0.8, 0.6)))
    close(neurons, [[0, 0], [6.108, 7.892], [10, 0], [-8, -6]])
    assert changed == pytest.approx(0.108, abs=1e-5)


def test_a_committed_neuron_has_nothing_more_to_learn():
    neurons = np.array([[0, 0], [8, 6]], np.float32)
    assert layers.learning(neurons, 1, 0.6, K, f1_with(U=(0.8, 0.6))) < 1e-6


def test_f1_settles_on_the_normalised_input():
    # first update: w = s, x = s (|s| = 1), v = f(x) = s; second: u = s, w = 11 s, x = s, p = q = s, v = 11 s
    f1 = f1_with(Q=(9.0, 9.0))
    layers.settle(S, NEURONS, K, f1)
    for row, expected in ((W, (8.8, 6.6)), (X, S), (V, (8.8, 6.6)), (U, S), (P, S), (Q, S)):
        close(f1[row], expected)


def test_noise_is_suppressed_and_signs_live():
    # theta 0.3, s = (-0.96, 0.28), |s| = 1. First update: x = s, v = (-0.96, 0).
    # Second: u = (-1, 0), w = (-0.96 - 10, 0.28), |w| = sqrt(120.1216 + 0.0784) = 10.963576,
    # x = (-0.999674, 0.025539), p = q = (-1, 0), v = (-0.999674 - 10, 0). Then u = (-1, 0).
    f1 = f1_with()
    layers.settle(np.array([-0.96, 0.28], np.float32), NEURONS, K._replace(theta=0.3), f1)
    for row, expected in ((W, (-10.96, 0.28)), (X, (-0.999674, 0.025539)), (V, (-10.999674, 0.0)), (U, (-1.0, 0.0)),
                          (P, (-1.0, 0.0)), (Q, (-1.0, 0.0))):
        close(f1[row], expected)


def test_resonance_brings_the_expectation_into_f1():
    # Neuron 1 wins: p = (6.2, 7.8), w = (8.8, 6.6), x = (0.8, 0.6), q = p / 9.963935 = (0.622244, 0.782823),
    # v = x + 10 q = (7.022442, 8.428232). Learning (alpha 0.6, u = s): t = (6.108, 7.892) as above.
    # F1 again: |v| = sqrt(49.314692 + 71.035095) = 10.970404, u = (0.640126, 0.768270);
    # w = s + 10 u = (7.201262, 8.282699); p = u + 0.9 t = (6.137326, 7.871070);
    # |w| = sqrt(51.858174 + 68.603103) = 10.975485, x = (0.656122, 0.754655);
    # |p| = sqrt(37.666770 + 61.953743) = 9.981008, q = (0.614900, 0.788605); v = (6.805122, 8.640705)
    neurons, f1 = NEURONS.copy(), f1_with()
    layers.settle(S, neurons, K, f1)
    layers.resonate(S, neurons, 1, 0.6, K, 1, 0.0, f1)
    close(neurons[1], (6.108, 7.892))
    for row, expected in ((U, (0.640126, 0.768270)), (W, (7.201262, 8.282699)), (P, (6.137326, 7.871070)),
                          (X, (0.656122, 0.754655)), (Q, (0.614900, 0.788605)), (V, (6.805122, 8.640705))):
        close(f1[row], expected)


def search(s, neurons, vigilance, k=K) -> tuple[int, float, int]:
    f1 = f1_with()
    layers.settle(np.array(s, np.float32), neurons, k, f1)
    return layers.search(neurons, k, vigilance, np.zeros(len(neurons), np.bool_), f1)


@pytest.mark.parametrize(('vigilance', 'winner'), [(0.0, 1), (0.99, 1), (0.995, NO_NEURON)])
def test_search_by_hand(vigilance, winner):
    # matches 0.991839, 0.957910, 0.111111: see stage 8; the best is neuron 1's whoever resonates
    found, match, nearest = search(S, NEURONS, vigilance)
    assert (found, nearest) == (winner, 1)
    assert match == pytest.approx(0.991839, abs=1e-6)


def test_the_next_neuron_is_tried_after_a_reset():
    # s = (1, 0): y of (8, 6) is 8, of (5, 0) is 5. Match of (8, 6): p = (8.2, 5.4), as neuron 2 of stage 8: 0.957910,
    # under 0.97: reset. Match of (5, 0): p = (5.5, 0), 1.55 / 1.55 = 1.
    neurons = np.array([[0, 0], [8, 6], [5, 0]], np.float32)
    assert search((1.0, 0.0), neurons, 0.97)[0] == 2
    assert search((1.0, 0.0), neurons, 0.95)[0] == 1


def test_e_lowers_the_bar():
    # e = 0.01: |v| = 11, so |u| = 11 / 11.01 = 0.999092 along s; p = u + 0.9 (8, 6): |p| = 9.999092;
    # |r| = (0.999092 + 0.9999092) / (0.01 + 0.999092 + 0.9999092) = 1.998999 / 2.009001 = 0.995022
    neurons, k = np.array([[0, 0], [8, 6]], np.float32), K._replace(e=0.01)
    assert search(S, neurons, 1.004, k) == (1, pytest.approx(0.995022, abs=2e-5), 1)  # bar 0.994
    assert search(S, neurons, 1.006, k)[0] == NO_NEURON                               # bar 0.996


def test_fast_learning_ends_where_an_update_changes_nothing():
    # The fixed point of stage 10 is t = u / (1 - d), whatever alpha: length 10 where |u| = 1.
    for rate in (0.2, 0.95):
        neurons, f1 = NEURONS.copy(), f1_with()
        layers.settle(S, neurons, K, f1)
        layers.resonate(S, neurons, 1, rate, K, 2000, 1e-6, f1)
        close(np.hypot(*neurons[1]) / 10.0, 1.0)
        np.testing.assert_allclose(neurons[1], f1[U] * 10.0, atol=0.03)  # float32 stops a little early


def test_any_dimension():
    # |(2, -1, 2, 4)| = 5: u = s / 5, weights of a neuron s / 5 / 0.1
    s = np.array([2, -1, 2, 4], np.float32)
    f1 = np.zeros((6, 4), np.float32)
    layers.settle(s, np.zeros((1, 4), np.float32), K, f1)
    close(f1[U], (0.4, -0.2, 0.4, 0.8))
    close(layers.commitment(f1[U], K), (4.0, -2.0, 4.0, 8.0))
