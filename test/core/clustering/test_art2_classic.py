"""Classic ART2 on frames: a plain NumPy reading of the book, a frame by hand, a synthetic flow."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from motion_detect_ros.core.background.planar import fit_background, motion_vectors
from motion_detect_ros.core.clustering.alternatives.art2_classic import SETTLED_SHARE, Art2Classic
from motion_detect_ros.core.clustering.art2 import make_art2
from motion_detect_ros.core.clustering.art2_network import MAX_PASSES, NOT_PRESENTED, VectorsError
from motion_detect_ros.core.config import Art2Config, BackgroundConfig, PipelineConfig
from motion_detect_ros.core.errors import ConfigError
from motion_detect_ros.core.settings import with_settings

CLASSIC = Art2Config(variant='classic', vigilance=0.95, background_sigma=1.0)


def clustered(vectors, **changes) -> tuple[np.ndarray, Art2Classic]:
    art2 = make_art2(dataclasses.replace(CLASSIC, **changes))
    assert isinstance(art2, Art2Classic)
    return art2.partial_fit(np.array(vectors, np.float32)), art2


def test_one_frame_by_hand():
    # (0.1, 0.1) is shorter than 1: background. Nothing is committed, all are equally novel: the smallest components
    # first, (-8, -6): u = (-0.8, -0.6), neuron 1 = u / 0.1. Matches: (4, 3) 0.111 (opposite), (6, -8) at a right angle:
    # u = (0.6, -0.8), p = (0.6 - 7.2, -0.8 - 5.4) = (-6.6, -6.2), |p| = 9.055385, u + p / 10 = (-0.06, -1.42),
    # 1.421267 / 1.905539 = 0.746. Most novel (4, 3): neuron 2 = (8, 6). Then (6, -8), neuron 3 = (6, -8).
    # Learning an input that a neuron was committed to changes nothing.
    labels, art2 = clustered([(6, -8), (4, 3), (-8, -6), (0.1, 0.1), (np.nan, 3)], initial_neurons=1)
    assert labels.tolist() == [3, 2, 1, 0, NOT_PRESENTED]
    np.testing.assert_allclose(art2.prototypes, [(0, 0), (-8, -6), (8, 6), (6, -8)], atol=1e-4)
    assert art2.names.tolist() == [0, 1, 2, 3]


def test_slow_learning_by_hand():
    # Of two equally novel vectors (-8, -6) has the smaller first component: neuron 1 = (-8, -6). (-3, -4) matches it
    # 0.9918 (test_art2_layers, stage 8): the same neuron. alpha = 0.6: t becomes 0.54 u + 0.946 t, for each vector
    # once: labels do not change, so there is no second pass. First u = (-0.8, -0.6) (t stays: it is its fixed point),
    # then (-0.6, -0.8): -0.324 - 7.568 = -7.892, -0.432 - 5.676 = -6.108. The other way round:
    # -0.432 - 0.946 * 7.892 = -7.897832, -0.324 - 0.946 * 6.108 = -6.102168.
    labels, art2 = clustered([(-3, -4), (-8, -6)], vigilance=0.9, learning_rate=0.6, initial_neurons=1)
    assert labels.tolist() == [1, 1]
    ends = ((-7.892, -6.108), (-7.897832, -6.102168))  # the order of a pass is fixed, but not by the book
    assert min(np.abs(art2.prototypes[1] - end).max() for end in ends) < 1e-4


def test_length_does_not_count():
    labels, art2 = clustered([(3, 4), (30, 40), (6, 8)])
    assert labels.tolist() == [1, 1, 1]
    np.testing.assert_allclose(art2.prototypes[1], (6, 8), atol=1e-3)  # the direction, length 1 / (1 - d)


def f(y, theta):
    return np.where(np.abs(y) > theta, y, 0.0)


def over(y, e):
    norm = e + np.linalg.norm(y)
    return y / norm if norm > 0 else y


def settled(s, k):
    """Fausett (1994), step 3, twice, then u."""
    u = p = q = np.zeros_like(s)
    w, x = s, over(s, k.e)
    v = f(x, k.theta)
    u = over(v, k.e)
    w, p = s + k.a * u, u
    x, q = over(w, k.e), over(p, k.e)
    v = f(x, k.theta) + k.b * f(q, k.theta)
    return over(v, k.e)


def reset_test(u, t, k):
    p = u + k.d * t
    return np.linalg.norm(u + k.c * p) / (k.e + np.linalg.norm(u) + k.c * np.linalg.norm(p))


def searched(u, weights, k):
    """Try the neurons one after the other, largest signal first. Returns winner or None, and all matches."""
    inhibited = set()
    matches = {j: reset_test(u, t, k) for j, t in enumerate(weights)}
    while len(inhibited) < len(weights):
        j = max((j for j in range(len(weights)) if j not in inhibited), key=lambda j: weights[j] @ u)
        if matches[j] >= k.vigilance - k.e:
            return j, matches
        inhibited.add(j)
    return None, matches


def learnt(s, u, t, k):
    """Steps 7 to 10 of a winner's weights."""
    p, w = u + k.d * t, s + k.a * u
    v = f(over(w, k.e), k.theta) + k.b * f(over(p, k.e), k.theta)
    alpha = k.learning_rate
    for _ in range(1 if k.learning == 'slow' else 1000):
        change = alpha * k.d * u + (1 + alpha * k.d * (k.d - 1)) * t - t
        t = t + change
        if np.abs(change).max() < SETTLED_SHARE * alpha * k.d:
            break
        u = over(v, k.e)
        w, p = s + k.a * u, u + k.d * t
        v = f(over(w, k.e), k.theta) + k.b * f(over(p, k.e), k.theta)
    return t


def reference(vectors, k):
    """(labels, weights, smallest margin of any decision)."""
    inputs = vectors.astype(np.float64)
    moving = np.linalg.norm(inputs, axis=1) > k.background_sigma
    us = np.array([settled(s, k) for s in inputs])
    rows, weights, margin = np.flatnonzero(moving), [], 1.0

    for limit, required in ((k.initial_neurons, 0.95), (k.max_neurons, k.vigilance)):
        while len(weights) + 1 < limit and len(rows):
            best = np.array([max([reset_test(us[i], t, k) for t in weights], default=-1.0) for i in rows])
            lowest = np.sort(best)
            margin = min(margin, abs(lowest[0] - required))
            if lowest[0] >= required:
                break
            if weights:
                margin = min(margin, *np.diff(lowest)[:1])
            candidates = sorted(rows[best == lowest[0]], key=lambda i: tuple(vectors[i]))
            weights.append(us[candidates[0]] / (1 - k.d))

    def recall():
        nonlocal margin
        labels = np.zeros(len(inputs), int)
        for i in rows:
            winner, matches = searched(us[i], weights, k)
            nearest = max(matches, key=lambda j: matches[j])
            signals = np.sort([weights[j] @ us[i] for j in matches])
            margin = min(margin, *np.abs(np.array(list(matches.values())) - k.vigilance), *np.diff(signals)[-1:])
            labels[i] = 1 + (nearest if winner is None else winner)
        return labels

    order = rows[np.lexsort(vectors[rows].T[::-1])]
    order = order[np.random.default_rng(0).permutation(len(order))]
    labels = recall()
    for _ in range(MAX_PASSES):
        for i in order:
            winner, _ = searched(us[i], weights, k)
            if winner is not None:
                weights[winner] = learnt(inputs[i], us[i], weights[winner], k)
        before, labels = labels, recall()
        if (before == labels).all():
            break
    return labels, np.array([np.zeros(inputs.shape[1]), *weights]), margin


@given(st.integers(0, 10_000), st.sampled_from([0.5, 0.9, 0.97, 0.99]), st.sampled_from(['slow', 'fast']),
       st.sampled_from([0.0, 0.1, 0.4]), st.integers(1, 6), st.integers(2, 4))
@settings(max_examples=25, deadline=None)
def test_kernels_agree_with_the_book_in_plain_numpy(seed, vigilance, learning, theta, initial, dimension):
    random = np.random.default_rng(seed)
    centres = random.uniform(-12, 12, (3, dimension))
    groups = [random.normal(c, 1.0, (6, dimension)) for c in centres]
    vectors = np.vstack([*groups, random.normal(0, 1, (8, dimension))]).astype(np.float32)
    config = dataclasses.replace(
        CLASSIC, vigilance=vigilance, learning=learning, theta=theta, initial_neurons=initial, max_neurons=8, e=0.001)
    labels, weights, margin = reference(vectors, config)
    if margin < 2e-4:  # a decision that float32 may take otherwise
        return
    art2 = Art2Classic(config)
    np.testing.assert_array_equal(art2.partial_fit(vectors), labels)
    np.testing.assert_allclose(art2.prototypes, weights, atol=0.02)


def test_objects_in_clearly_different_directions_are_separate_clusters():
    random = np.random.default_rng(7)
    residual = random.normal(0.0, 0.2, (80, 120, 2)).astype(np.float32)
    owner = np.zeros((80, 120), int)
    for number, degrees in enumerate((10.0, 130.0, 250.0), start=1):
        top, left = 10 + 20 * (number - 1), 15 + 30 * (number - 1)
        owner[top:top + 12, left:left + 16] = number
        direction = np.array([np.cos(np.radians(degrees)), np.sin(np.radians(degrees))])
        residual[owner == number] += (3.0 + number) * direction  # three speeds too
    background = fit_background(residual, BackgroundConfig(), np.zeros((80, 120), np.float32))
    vectors = motion_vectors(residual, background)
    labels, _ = clustered(vectors.reshape(-1, 2), background_sigma=4.0, initial_neurons=1)
    labels = labels.reshape(80, 120)
    assert (labels[owner == 0] == 0).mean() > 0.999
    names = [np.bincount(labels[owner == number]).argmax() for number in (1, 2, 3)]
    assert sorted(names) == [1, 2, 3]
    assert all((labels[owner == number] == name).mean() > 0.99 for number, name in zip((1, 2, 3), names, strict=True))


def test_vectors_of_another_dimension_are_refused_once_neurons_are_committed():
    _, art2 = clustered(np.eye(3) * 20)
    with pytest.raises(VectorsError, match=r'vectors: expected shape \(N, 3\) as before, got \(4, 2\)'):
        art2.partial_fit(np.zeros((4, 2), np.float32))
    art2.reset()
    assert art2.partial_fit(np.full((4, 2), 9, np.float32)).tolist() == [1] * 4


def test_vectors_under_theta_everywhere_are_background():
    # 100 equal components of a unit vector are 0.1 each: with theta 0.2 nothing passes F1
    labels, _ = clustered(np.full((2, 100), 5.0), theta=0.2)
    assert labels.tolist() == [0, 0]


def test_memory_without_neurons_recalls_background():
    art2 = make_art2(CLASSIC)
    assert art2.predict(np.array([(9, 9), (np.inf, 0)], np.float32)).tolist() == [0, NOT_PRESENTED]


@pytest.mark.parametrize(('values', 'words'), [
    ({'art2.c': 0.2}, r'art2.c, art2.d: expected c d / \(1 - d\) of at most 1, got 1.8'),  # 0.2 * 0.9 / 0.1
    ({'art2.d': 0.95}, r'art2.c, art2.d: expected c d / \(1 - d\) of at most 1, got 1.9'),  # 0.1 * 0.95 / 0.05
    ({'art2.variant': 'modern'}, r"art2.variant: expected one of magnitude, classic, got 'modern'"),
    ({'art2.learning': 'lazy'}, r"art2.learning: expected one of slow, fast, got 'lazy'"),
])
def test_wrong_settings_are_refused(values, words):
    with pytest.raises(ConfigError, match=words):
        with_settings(PipelineConfig(), values)


def test_the_constraint_may_hold_exactly():
    assert with_settings(PipelineConfig(), {'art2.d': 0.5, 'art2.c': 1.0}).art2.c == 1.0  # 1 * 0.5 / 0.5 = 1
