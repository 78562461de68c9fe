"""What must hold for both variants of ART2, whatever the vectors; merging of duplicates."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from motion_detect_ros.core.clustering.art2 import make_art2
from motion_detect_ros.core.clustering.art2_network import NOT_PRESENTED, VectorsError
from motion_detect_ros.core.config import Art2Config

VARIANTS = ('magnitude', 'classic')
#: Whole and half numbers: exact in float32, many ties.
vector_sets = st.lists(
    st.tuples(*[st.integers(-60, 60).map(lambda n: n / 2)] * 2), min_size=1, max_size=40)
variants = st.sampled_from(VARIANTS)


def config(variant: str, **changes) -> Art2Config:
    base = Art2Config(variant=variant, background_sigma=1.5, vigilance=0.3 if variant == 'magnitude' else 0.95)
    return dataclasses.replace(base, **changes)


def rows(vectors) -> np.ndarray:
    return np.array(vectors, np.float32).reshape(-1, 2)


@given(variants, vector_sets, st.integers(1, 6), st.integers(2, 40))
@settings(max_examples=60, deadline=None)
def test_neurons_never_fall_as_vigilance_rises(variant, vectors, initial, maximum):
    counts = []
    for vigilance in (0.0, 0.1, 0.3, 0.6, 0.8, 0.9, 0.95, 0.98, 1.0):
        art2 = make_art2(config(variant, vigilance=vigilance, initial_neurons=initial,
                                max_neurons=max(initial, maximum)))
        art2.partial_fit(rows(vectors))
        counts.append(len(art2.prototypes))
    assert counts == sorted(counts)


@given(variants, vector_sets, st.sampled_from([0.7, 1.0]), st.randoms(use_true_random=False))
@settings(max_examples=100, deadline=None)
def test_the_raster_does_not_matter(variant, vectors, merge_match, random):
    order = list(range(len(vectors)))
    random.shuffle(order)
    straight, shuffled = (make_art2(config(variant, merge_match=merge_match)) for _ in range(2))
    labels = straight.partial_fit(rows(vectors))
    np.testing.assert_array_equal(shuffled.partial_fit(rows(vectors)[order]), labels[order])
    np.testing.assert_allclose(shuffled.prototypes, straight.prototypes, rtol=1e-6)


@pytest.mark.parametrize('learning', ['slow', 'fast'])
@pytest.mark.parametrize('variant', VARIANTS)
def test_same_frames_same_bytes(variant, learning):
    frames = np.random.default_rng(5).normal(0, 9, (3, 2000, 2)).astype(np.float32)
    one, two = (make_art2(config(variant, learning=learning, merge_match=0.9)) for _ in range(2))
    for frame in frames:
        assert one.partial_fit(frame).tobytes() == two.partial_fit(frame).tobytes()
        assert one.prototypes.tobytes() == two.prototypes.tobytes()


@given(variants, st.lists(vector_sets, min_size=1, max_size=4), st.integers(1, 5), st.integers(2, 8))
@settings(max_examples=50, deadline=None)
def test_neurons_never_exceed_the_maximum_and_labels_name_neurons(variant, frames, initial, maximum):
    maximum = max(initial, maximum)
    art2 = make_art2(config(variant, initial_neurons=initial, max_neurons=maximum, forget_s=0.08))
    for vectors in frames:
        labels = art2.partial_fit(rows(vectors))
        assert len(art2.prototypes) == len(art2.names) == len(set(art2.names.tolist())) <= maximum
        assert labels.min() >= 0 and labels.max() < len(art2.prototypes)
        assert not art2.prototypes[0].any()


@given(variants, vector_sets, st.lists(st.sampled_from([(np.nan, 1), (2, np.nan), (np.inf, 9), (9, -np.inf)]),
                                       min_size=1, max_size=4), st.randoms(use_true_random=False))
@settings(max_examples=60, deadline=None)
def test_unknown_vectors_are_never_presented(variant, vectors, unknown, random):
    mixed = [*vectors, *unknown]
    random.shuffle(mixed)
    with_unknown, without = make_art2(config(variant)), make_art2(config(variant))
    labels = with_unknown.partial_fit(rows(mixed))
    known = np.isfinite(rows(mixed)).all(axis=1)
    assert (labels[~known] == NOT_PRESENTED).all()
    np.testing.assert_array_equal(labels[known], without.partial_fit(rows(mixed)[known]))
    np.testing.assert_array_equal(with_unknown.prototypes, without.prototypes)


@given(variants, vector_sets)
@settings(max_examples=60, deadline=None)
def test_recall_learns_nothing(variant, vectors):
    art2 = make_art2(config(variant))
    labels = art2.partial_fit(rows(vectors))
    before = art2.prototypes.tobytes(), art2.names.tobytes()
    recalled = art2.predict(rows(vectors))
    np.testing.assert_array_equal(art2.predict(rows(vectors)), recalled)
    assert (art2.prototypes.tobytes(), art2.names.tobytes()) == before
    np.testing.assert_array_equal(recalled, labels)


@pytest.mark.parametrize('variant', VARIANTS)
def test_one_motion_keeps_its_name_over_frames(variant):
    random = np.random.default_rng(3)
    art2 = make_art2(config(variant, initial_neurons=1))
    motions = np.array([(14.0, 3.0), (-12.0, 6.0)])
    seen = []
    for frame in range(12):
        turned = motions + 0.3 * frame  # drifts, as motions do
        groups = [random.normal(motion, 0.3, (40, 2)) for motion in turned]
        labels = art2.partial_fit(np.vstack([*groups, random.normal(0, 0.3, (60, 2))]).astype(np.float32))
        seen.append([int(art2.names[np.bincount(labels[part]).argmax()]) for part in (slice(0, 40), slice(40, 80))])
    assert len({tuple(names) for names in seen}) == 1
    assert 0 < seen[0][0] != seen[0][1] > 0


@pytest.mark.parametrize('variant', VARIANTS)
def test_a_motion_that_stops_is_forgotten_and_its_name_is_not_used_again(variant):
    art2 = make_art2(config(variant, initial_neurons=1, forget_s=0.12))
    moving, still = np.full((5, 2), 12, np.float32), np.zeros((5, 2), np.float32)
    art2.partial_fit(moving)
    for idle in range(1, 5):  # after three frames without a win the fourth frame starts without it
        art2.partial_fit(still)
        assert len(art2.prototypes) == (2 if idle < 4 else 1)
    art2.partial_fit(moving)
    assert art2.names.tolist() == [0, 2]
    art2.reset()
    assert len(art2.prototypes) == 1


def test_duplicates_become_one_at_their_weighted_mean():
    # Neurons at vigilance 1: (10, 0), (11, 0) and (0, 20). Match of the first two: 1 - 1 / 22 = 0.9545; of (0, 20) with
    # the longer one: 1 - sqrt(121 + 400) / 32 = 0.287. Most novel is (0, 20) (background: 1/21), then (10, 0): it is
    # 1 - sqrt(500) / 31 = 0.279 from (0, 20), (11, 0) is 0.287. The older, (10, 0), won three vectors, (11, 0) one:
    # 10 + 1 / 4 = 10.25.
    vectors = rows([(10, 0), (10, 0), (10, 0), (11, 0), (0, 20)])
    art2 = make_art2(config('magnitude', vigilance=1.0, initial_neurons=1, merge_match=0.95))
    labels = art2.partial_fit(vectors)
    assert labels.tolist() == [2, 2, 2, 2, 1]
    np.testing.assert_allclose(art2.prototypes, [(0, 0), (0, 20), (10.25, 0)])
    assert art2.names.tolist() == [0, 1, 2]
    apart = make_art2(config('magnitude', vigilance=1.0, initial_neurons=1, merge_match=0.96))
    assert len(set(apart.partial_fit(vectors))) == 3


def test_duplicate_directions_become_one():
    # Unit vectors 20 degrees apart: template 10 (1, 0), u = (cos 20, sin 20): p = u + 9 (1, 0) = (9.939693, 0.342020),
    # |p| = 9.945575; u + p / 10 = (1.933662, 0.376222), length 1.969921; over 1.994558: 0.987648.
    angle = np.radians(20.0)
    vectors = rows([(10, 0), (10, 0), (10 * np.cos(angle), 10 * np.sin(angle))])
    for merge_match, neurons in ((0.987, 1), (0.988, 2)):
        art2 = make_art2(config('classic', vigilance=0.999, initial_neurons=1, merge_match=merge_match))
        labels = art2.partial_fit(vectors)
        assert len(art2.prototypes) == 1 + neurons and len(set(labels)) == neurons


def test_merged_neurons_match_at_most_the_limit():
    vectors = np.random.default_rng(8).uniform(-30, 30, (400, 2)).astype(np.float32)
    for variant, limit in (('magnitude', 0.6), ('classic', 0.97)):
        art2 = make_art2(config(variant, merge_match=limit, vigilance=0.99, max_neurons=40))
        art2.partial_fit(vectors)
        pairs = np.triu(art2._pair_matches()[1:, 1:], 1)
        assert 2 < len(art2.prototypes) < 40 and pairs.max() <= limit


@pytest.mark.parametrize('variant', VARIANTS)
@pytest.mark.parametrize('shape', [(4,), (2, 3, 2), (3, 0)])
def test_vectors_of_a_wrong_shape_are_refused(variant, shape):
    with pytest.raises(VectorsError, match=r'vectors: expected shape \(N, D\), got \('):
        make_art2(config(variant)).partial_fit(np.zeros(shape, np.float32))


@pytest.mark.parametrize('variant', VARIANTS)
def test_empty_frames_are_frames(variant):
    assert make_art2(config(variant)).partial_fit(np.zeros((0, 2), np.float32)).shape == (0,)


def test_magnitude_takes_any_dimension():
    # |(9, 9, 9, 9)| = 18, background match 1 / 19; the opposite matches 1 - 36 / 37
    labels = make_art2(config('magnitude')).partial_fit(
        np.array([[9] * 4, [-9] * 4, [0.1] * 4, [9.1, 9, 9, 9]], np.float32))
    assert labels[2] == 0 and labels[0] == labels[3] != labels[1] > 0
