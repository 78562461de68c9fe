"""ART2, magnitude variant: numbers worked by hand, a reference in plain Python, and what must always hold."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from motion_detect_ros.core.clustering.art2 import MAX_PASSES, NOT_PRESENTED, Art2, similarity
from motion_detect_ros.core.config import Art2Config


def clustered(vectors, **config) -> tuple[np.ndarray, Art2]:
    art2 = Art2(Art2Config(**config))
    return art2.partial_fit(np.array(vectors, np.float32)), art2


@pytest.mark.parametrize(('s', 't', 'match'), [
    ((3.0, 4.0), (3.0, 4.0), 1.0),                      # equal
    ((3.0, 4.0), (0.0, 0.0), 1.0 - 5.0 / 6.0),          # |s - t| = 5, |s| + |t| + 1 = 6
    ((2.0, 0.0), (-2.0, 0.0), 1.0 - 4.0 / 5.0),         # opposite
    ((2.0, 0.0), (6.0, 0.0), 1.0 - 4.0 / 9.0),          # same direction, three times the speed
    ((1.0, 0.0), (0.0, 1.0), 1.0 - 2 ** 0.5 / 3.0),     # right angle
    ((0.0, 0.0), (0.0, 0.0), 1.0),
])
def test_match_by_hand(s, t, match):
    assert similarity(*s, *t) == pytest.approx(match, abs=1e-12)
    assert similarity(*t, *s) == pytest.approx(match, abs=1e-12)


def test_one_step_by_hand():
    # Vigilance 0.5, rate 0.5, no spreading (one initial neuron = the background).
    # (0.5, 0): match with background 1 - 0.5/1.5 = 0.667 >= 0.5: resonates there.
    # (8, 0): 1 - 8/9 = 0.111, (10, 0): 1/11 = 0.091, (0, 6): 1/7 = 0.143: all reset the background.
    # Most novel is (10, 0): commits neuron 1. (8, 0) matches it 1 - 2/19 = 0.895: resonates.
    # (0, 6) matches it 1 - sqrt(136)/17 = 0.314, under 0.5: commits neuron 2.
    # Learning, pass 1: neuron 1 goes half way from 10 to the mean 9 of what it won: 9.5. Pass 2 would go on:
    # assignments do not change any more after it, so it is the last.
    vectors = [(0.5, 0.0), (8.0, 0.0), (10.0, 0.0), (0.0, 6.0)]
    labels, art2 = clustered(vectors, vigilance=0.5, learning_rate=0.5, initial_neurons=1, max_neurons=10)
    assert labels.tolist() == [0, 1, 1, 2]
    np.testing.assert_allclose(art2.prototypes, [[0, 0], [9.5, 0], [0, 6]])


def test_two_speeds_in_one_direction_are_two_clusters():
    random = np.random.default_rng(0)
    slow, fast = random.normal((6, 0), 0.2, (50, 2)), random.normal((24, 0), 0.2, (50, 2))
    labels, _ = clustered(np.vstack([slow, fast]), vigilance=0.2)
    assert len(set(labels[:50])) == len(set(labels[50:])) == 1
    assert labels[0] != labels[50] and 0 not in labels


@pytest.mark.parametrize(('spread_match', 'clusters'), [(0.6, 1), (0.8, 2)])
def test_spread_match_says_which_speeds_are_apart(spread_match, clusters):
    """5 and 10 noise units in one direction match 1 - 5/16 = 0.69."""
    labels, _ = clustered([(5, 0), (10, 0)], vigilance=0.2, spread_match=spread_match)
    assert len(set(labels)) == clusters and 0 not in labels


def test_opposite_directions_are_two_clusters():
    random = np.random.default_rng(0)
    right, left = random.normal((9, 2), 0.2, (50, 2)), random.normal((-9, -2), 0.2, (50, 2))
    labels, _ = clustered(np.vstack([right, left]), vigilance=0.2)
    assert len(set(labels[:50])) == len(set(labels[50:])) == 1
    assert labels[0] != labels[50]


vector_sets = st.lists(st.tuples(st.floats(-30, 30, width=32), st.floats(-30, 30, width=32)), min_size=1, max_size=40)


@given(vector_sets, st.integers(1, 6), st.integers(2, 40))
@settings(max_examples=150, deadline=None)
def test_cluster_count_never_falls_as_vigilance_rises(vectors, initial, maximum):
    counts = [len(clustered(vectors, vigilance=v, initial_neurons=initial, max_neurons=max(initial, maximum))[1]
                  .prototypes) for v in (0.0, 0.1, 0.2, 0.35, 0.5, 0.65, 0.8, 0.9, 1.0)]
    assert counts == sorted(counts)


def test_vigilance_0_accepts_everything_and_1_only_equality():
    vectors = [(0, 0), (5, 0), (5, 0), (-7, 3), (5, 0.01)]
    assert clustered(vectors, vigilance=0.0, initial_neurons=1)[0].tolist() == [0] * 5
    labels = clustered(vectors, vigilance=1.0, initial_neurons=1)[0]
    assert labels[1] == labels[2] and len(set(labels)) == 4


@given(vector_sets, st.randoms(use_true_random=False))
@settings(max_examples=60, deadline=None)
def test_order_of_presentation_does_not_matter(vectors, random):
    order = list(range(len(vectors)))
    random.shuffle(order)
    straight, _ = clustered(vectors, vigilance=0.3)
    shuffled, _ = clustered([vectors[i] for i in order], vigilance=0.3)
    groups = {frozenset(np.flatnonzero(straight == label)) for label in set(straight)}
    again = {frozenset(order[i] for i in np.flatnonzero(shuffled == label)) for label in set(shuffled)}
    if len({tuple(v) for v in vectors}) == len(vectors) and not ties(vectors):
        assert groups == again


def ties(vectors) -> bool:
    """Equally novel vectors may be presented in either order; then there is nothing to compare."""
    art2 = reference(np.array(vectors, np.float32), Art2Config(vigilance=0.3))
    return art2[2]


def reference(vectors: np.ndarray, config: Art2Config):
    """The same method in plain numpy: labels, prototypes, and whether any choice was a near tie."""
    def match(a, b):
        d = np.linalg.norm(a[:, None].astype(float) - b[None].astype(float), axis=2)
        return 1 - d / (np.linalg.norm(a, axis=1)[:, None] + np.linalg.norm(b, axis=1)[None] + 1)

    prototypes, tie = np.zeros((1, 2)), False

    def compete():
        m = match(vectors, prototypes)
        best = m.argmax(axis=1)
        best[m[:, 0] >= config.vigilance] = 0
        return best, m.max(axis=1), m  # novelty is against any neuron, whoever wins

    phases = ((config.initial_neurons, config.spread_match, 0.2), (config.max_neurons, config.vigilance, 1.1))
    for limit, required, background in phases:
        while len(prototypes) < limit:
            _, value, m = compete()
            open_to = m[:, 0] < background
            if not open_to.any() or value[open_to].min() >= required:
                break
            worst = np.sort(value[open_to])
            tie |= len(worst) > 1 and worst[1] - worst[0] < 1e-5
            prototypes = np.vstack([prototypes, vectors[np.flatnonzero(open_to)[value[open_to].argmin()]]])
    labels, _, m = compete()
    for _ in range(MAX_PASSES):
        for j in range(1, len(prototypes)):
            if (labels == j).any():
                prototypes[j] += config.learning_rate * (vectors[labels == j].mean(axis=0) - prototypes[j])
        before = labels
        labels, _, m = compete()
        if (before == labels).all():
            break
    two = np.sort(m, axis=1)[:, -2:]
    tie |= bool(len(prototypes) > 1 and (np.diff(two, axis=1) < 1e-5).any())
    tie |= bool((np.abs(m[:, 0] - config.vigilance) < 1e-5).any() or (np.abs(m - config.spread_match) < 1e-5).any())
    tie |= bool((np.abs(m[:, 0] - 0.2) < 1e-5).any())
    return labels, prototypes, tie


@given(st.integers(0, 10_000), st.sampled_from([0.1, 0.2, 0.3, 0.5, 0.8]), st.integers(1, 8),
       st.sampled_from([0.5, 0.6, 0.8]))
@settings(max_examples=60, deadline=None)
def test_kernels_agree_with_plain_numpy(seed, vigilance, initial, spread):
    random = np.random.default_rng(seed)
    centres = random.uniform(-15, 15, (4, 2))
    vectors = np.vstack([random.normal(c, 0.5, (20, 2)) for c in centres] + [random.normal(0, 1, (40, 2))])
    vectors = vectors.astype(np.float32)
    config = Art2Config(vigilance=vigilance, initial_neurons=initial, max_neurons=12, spread_match=spread)
    labels, prototypes, tie = reference(vectors, config)
    if tie:
        return
    art2 = Art2(config)
    np.testing.assert_array_equal(art2.partial_fit(vectors), labels)
    np.testing.assert_allclose(art2.prototypes, prototypes, atol=1e-3)


def test_background_stays_at_zero_and_unknown_vectors_are_not_presented():
    labels, art2 = clustered([(0.1, 0.1), (np.nan, 1.0), (20, 0), (0.2, -0.1)], vigilance=0.3)
    assert labels[1] == NOT_PRESENTED and labels[0] == labels[3] == 0
    np.testing.assert_array_equal(art2.prototypes[0], [0, 0])


def test_names_begin_again_after_the_last_one_that_a_message_can_hold():
    """200 neurons that are forgotten every 0.4 s use up uint32 in 100 days."""
    art2 = Art2(Art2Config())
    art2._next_name = 2 ** 32 - 1
    for _ in range(2):
        art2.partial_fit(np.float32([[50, 0], [0, 50], [-50, 0]]))
    assert sorted(art2.names.tolist()) == [0, 1, 2, 2 ** 32 - 1]


def winner_name(art2: Art2, vectors: np.ndarray, dt_s: float = 0.04) -> int:
    """Name of the neuron that wins the second vector."""
    label = art2.partial_fit(vectors, dt_s)[1]
    return int(art2.names[label])


def test_memory_lasts_over_frames_and_idle_neurons_are_forgotten():
    art2 = Art2(Art2Config(vigilance=0.2, forget_s=0.12, initial_neurons=2))
    car = np.array([[0, 0], [12, 0], [12.2, 0]], np.float32)
    name = winner_name(art2, car)
    assert winner_name(art2, car + np.float32([0, 0.3])) == name
    still = np.zeros((3, 2), np.float32)
    for _ in range(5):
        art2.partial_fit(still)
    assert len(art2.prototypes) == 1
    assert winner_name(art2, car) != name


@pytest.mark.parametrize(('forget_s', 'dt_s'), [(0.4, 0.7), (0.4, 0.9), (0.4, 5.0), (0.001, 0.04)])
def test_what_wins_in_every_frame_is_not_forgotten_however_long_frames_take(forget_s: float, dt_s: float):
    art2 = Art2(Art2Config(vigilance=0.2, forget_s=forget_s, initial_neurons=2))
    car = np.array([[0, 0], [12, 0], [12.2, 0]], np.float32)
    assert len({winner_name(art2, car, dt_s) for _ in range(5)}) == 1
    for _ in range(2):
        art2.partial_fit(np.zeros((3, 2), np.float32), dt_s)
    assert len(art2.prototypes) == 1, 'what does not win is'


def test_growth_stops_at_the_maximum():
    random = np.random.default_rng(4)
    labels, art2 = clustered(random.uniform(-40, 40, (500, 2)), vigilance=0.9, initial_neurons=3, max_neurons=7)
    assert len(art2.prototypes) == 7
    assert labels.min() >= 0 and labels.max() == 6


def test_same_input_same_bytes():
    vectors = np.random.default_rng(5).normal(0, 9, (3000, 2))
    a, b = clustered(vectors, vigilance=0.3), clustered(vectors, vigilance=0.3)
    assert a[0].tobytes() == b[0].tobytes()
    assert a[1].prototypes.tobytes() == b[1].prototypes.tobytes()
