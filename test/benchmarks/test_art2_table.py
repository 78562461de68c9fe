"""The comparison of clusterers: index and flights by hand, choice of parameters, what is left out."""

from __future__ import annotations

import dataclasses
import json
import sys

import numpy as np
import pytest

from motion_detect_ros.benchmarks import art2_table
from motion_detect_ros.benchmarks.art2_table import (
    LabelledVectors,
    adjusted_rand_index,
    compare,
    flight_of,
    labelled_vectors,
    main,
    measure,
    table,
    tuned,
)
from motion_detect_ros.benchmarks.clusterers import CLUSTERERS, Clusterer
from motion_detect_ros.sources.synthetic import FlightConfig, SyntheticFlight

SPLIT = [0, 0, 1, 1]


@pytest.mark.parametrize(('labels', 'index'), [
    ([5, 5, 2, 2], 1.0),
    ([0, 0, 1, 2], 4 / 7),   # pairs: 1 together, 2 and 1 alone, expected 2 * 1 / 6; (1 - 1/3) / (3/2 - 1/3)
    ([0, 1, 0, 1], -0.5),    # pairs: 0 together, 2 and 2 alone, expected 2 * 2 / 6; (0 - 2/3) / (2 - 2/3)
    ([0, 0, 0, 0], 0.0),     # pairs: 2 together, 2 and 6 alone, expected 2 * 6 / 6
])
def test_adjusted_rand_index_by_hand(labels, index):
    assert adjusted_rand_index(SPLIT, labels) == pytest.approx(index)
    assert adjusted_rand_index(labels, SPLIT) == pytest.approx(index)


def test_adjusted_rand_index_of_one_cluster_each():
    assert adjusted_rand_index([3, 3], [0, 0]) == 1.0


def test_adjusted_rand_index_is_that_of_scikit_learn():
    metrics = pytest.importorskip('sklearn.metrics')
    random = np.random.default_rng(0)
    one = random.integers(0, 4, 300)
    other = np.where(random.random(300) < 0.7, one, random.integers(0, 6, 300))
    assert adjusted_rand_index(one, other) == pytest.approx(metrics.adjusted_rand_score(one, other))


def test_vectors_are_those_of_the_objects():
    flight = SyntheticFlight(FlightConfig.single(60.0, 4.0, direction_deg=90.0))
    found = labelled_vectors(flight.frame(15), seed=1)
    moving = found.vectors[found.owners > 0]
    assert len(moving) == pytest.approx(60 * 60, rel=0.05)
    x, y = moving.mean(axis=0)  # down in the image, 4 px in units of at least the noise that was added
    assert abs(x) < 0.1 and 4.0 / 0.6 < y <= 4.0 / 0.25
    np.testing.assert_allclose(found.vectors[found.owners == 0].mean(axis=0), 0.0, atol=0.05)


def test_flights_have_three_directions_at_two_speeds():
    boxes = flight_of(5).objects
    assert [box.speed_m_s for box in boxes] == [4.0, 10.0] * 3
    np.testing.assert_allclose(np.diff([box.heading_deg for box in boxes[::2]]), 120.0)
    assert [box.heading_deg for box in boxes[::2]] == [box.heading_deg for box in boxes[1::2]]
    assert flight_of(5) == flight_of(5) != flight_of(6)


def test_sample_is_spread_and_keeps_pairs():
    everything = LabelledVectors(np.arange(20, dtype=np.float32).reshape(10, 2), np.arange(10))
    few = everything.sample(4)
    assert few.owners.tolist() == [0, 3, 6, 9]
    np.testing.assert_array_equal(few.vectors[:, 0], 2 * few.owners)


def by_threshold(vectors, parameters):
    return (vectors[:, 0] > parameters.get('over', 0)).astype(np.int64) + 2 * (vectors[:, 1] > 0)


@pytest.fixture
def frame():
    """Background at (0, 0), movers at (5, 0) and (5, 5)."""
    vectors = np.repeat(np.array([(0, 0), (5, 0), (5, 5)], np.float32), 100, axis=0)
    return LabelledVectors(vectors, np.repeat([0, 1, 2], 100))


def test_the_best_of_the_grid_is_taken(frame):
    clusterer = Clusterer('threshold', by_threshold, {'over': (-1.0, 2.0, 9.0)})
    assert tuned(clusterer, [frame]) == {'over': 2.0}


def test_scores_of_a_perfect_and_a_blind_clusterer(frame):
    row = measure(Clusterer('threshold', by_threshold, {'over': (2.0,)}), [frame], [frame])
    assert (row.index, row.movers, row.worst, row.clusters) == (1.0, 1.0, 1.0, 3.0)
    blind = measure(Clusterer('blind', lambda vectors, _: np.zeros(len(vectors), np.int64)), [frame], [frame])
    assert (blind.index, blind.movers, blind.clusters) == (0.0, 0.0, 1.0)


def test_what_needs_too_much_memory_is_not_run(frame):
    sizes = []

    def run(vectors, parameters):
        sizes.append(len(vectors))
        return by_threshold(vectors, parameters)

    row = measure(Clusterer('small', run, most_vectors=25_000), [frame], [frame])
    assert 80_000 not in sizes and {5_000, 20_000} <= set(sizes)
    assert np.isnan(row.times_ms[2]) and not np.isnan(row.times_ms[:2]).any()
    assert '| not run |' in table([row])[2]


def test_what_takes_too_long_is_not_run(frame, monkeypatch):
    monkeypatch.setattr(art2_table, 'TOO_LONG_S', 0.0)
    row = measure(Clusterer('slow', by_threshold), [frame], [frame])
    assert np.isnan(row.times_ms).all()


def test_what_is_not_installed_is_left_out_with_a_note(frame, monkeypatch):
    monkeypatch.setitem(sys.modules, 'sklearn', None)
    said = []
    missing = Clusterer('MiniBatchKMeans', by_threshold, library='sklearn')
    rows = compare([missing, Clusterer('threshold', by_threshold)], [frame], [frame], said.append)
    assert [row.name for row in rows] == ['threshold']
    assert said[0] == ('left out: MiniBatchKMeans: expected scikit-learn; '
                       "install it: pip install 'motion_detect_ros[compare]'")


def test_rows_come_best_first(frame):
    blind = Clusterer('blind', lambda vectors, _: np.zeros(len(vectors), np.int64))
    rows = compare([blind, Clusterer('threshold', by_threshold, {'over': (2.0,)})], [frame], [frame], [].append)
    assert [row.name for row in rows] == ['threshold', 'blind']


def test_worst_is_the_lowest_mean_of_a_seed(frame):
    """Seed 1: indices 1 and 0, mean 0.5; seed 2: 1 and 1; all: 0.75."""
    still = LabelledVectors(np.zeros_like(frame.vectors), frame.owners, seed=1)
    good = dataclasses.replace(frame, seed=2)
    frames = [dataclasses.replace(frame, seed=1), still, good, good]
    row = measure(Clusterer('threshold', by_threshold, {'over': (2.0,)}), [frame], frames)
    assert (row.index, row.worst) == (0.75, 0.5) and (row.movers, row.worst_movers) == (0.75, 0.5)
    assert '| 0.75, 0.50 | 0.75, 0.50 |' in table([row])[2]


def test_command_compares_art2_without_any_library(tmp_path, capsys, monkeypatch):
    """At full size: in a smaller picture the slower boxes move by less than what ART2 takes for background."""
    monkeypatch.setattr(art2_table, 'FRAMES', (25,))
    figures = tmp_path / 'figures.json'
    assert main(['--seeds', '1', '--tuning-seeds', '101', '--only', 'ART2 magnitude,', '--json', str(figures)]) == 0
    (row,) = json.loads(figures.read_text())
    assert row['name'] == 'ART2 magnitude, defaults' and row['index'] > 0.8 and row['movers'] > 0.6
    head, _, line = capsys.readouterr().out.splitlines()
    assert head.count('|') == line.count('|') and line.startswith('| ART2 magnitude, defaults | ')


@pytest.mark.parametrize(('arguments', 'message'), [
    (['--seeds', '1', '2', '--tuning-seeds', '2'], '--seeds: expected other seeds than --tuning-seeds'),
    (['--only', 'OPTICS'], '--only: expected the beginning of some of ART2 magnitude, defaults, ART2 magnitude'),
])
def test_wrong_use(arguments, message, capsys):
    with pytest.raises(SystemExit) as stopped:
        main(arguments)
    assert stopped.value.code == 2 and message in capsys.readouterr().err


@pytest.mark.parametrize('clusterer', CLUSTERERS, ids=lambda each: each.name)
def test_every_clusterer_labels_two_far_groups(clusterer, frame):
    """Not those of artlib's ART2A, which sees directions from a corner only: one label for each vector."""
    if clusterer.library:
        pytest.importorskip(clusterer.library)
    vectors = frame.vectors + np.random.default_rng(0).normal(0, 0.1, frame.vectors.shape).astype(np.float32)
    best = max(adjusted_rand_index(frame.owners, clusterer.run(vectors, choice)) for choice in clusterer.choices())
    assert best > (0.2 if clusterer.name == 'artlib ART2A' else 0.9)
