"""Against numpy's own."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays

from motion_detect_ros.core.geometry.order_statistics import column_medians, grouped_medians, median, percentile, select

FEW = arrays(np.float32, st.integers(1, 40), elements=st.integers(-20, 20).map(float))


@settings(deadline=None)
@given(values=FEW)
def test_median(values: np.ndarray):
    assert median(values.copy()) == pytest.approx(float(np.median(values)), abs=1e-6)


@settings(deadline=None)
@given(values=arrays(np.float32, st.tuples(st.integers(1, 20), st.integers(1, 3)),
                     elements=st.integers(-20, 20).map(float)))
def test_column_medians_leave_the_values_as_they_are(values: np.ndarray):
    before = values.copy()
    np.testing.assert_allclose(column_medians(values), np.median(values, axis=0), atol=1e-6)
    np.testing.assert_array_equal(values, before)


@pytest.mark.parametrize('kind', [np.float32, np.float64])
def test_medians_of_groups(kind: type):
    values, sizes = np.random.default_rng(0).normal(size=(60, 2)).astype(kind), np.array([1, 2, 7, 30, 20])
    before, ends = values.copy(), np.cumsum(sizes)
    expected = [np.median(values[end - size:end], axis=0) for end, size in zip(ends, sizes, strict=True)]
    np.testing.assert_allclose(grouped_medians(values, sizes), expected, rtol=1e-6)
    np.testing.assert_array_equal(values, before)


@settings(deadline=None)
@given(values=FEW, percent=st.integers(0, 100))
def test_percentile(values: np.ndarray, percent: int):
    assert percentile(values.copy(), float(percent)) == pytest.approx(float(np.percentile(values, percent)), abs=1e-4)


@settings(deadline=None)
@given(values=FEW, data=st.data())
def test_select_parts_the_values(values: np.ndarray, data: st.DataObject):
    rank, ordered = data.draw(st.integers(0, len(values) - 1)), values.copy()
    assert select(ordered, rank) == np.sort(values)[rank]
    assert (ordered[:rank] <= ordered[rank]).all() and (ordered[rank:] >= ordered[rank]).all()
    np.testing.assert_array_equal(np.sort(ordered), np.sort(values))


@pytest.mark.parametrize('values', [
    np.arange(3000.0), np.arange(3000.0)[::-1], np.r_[np.arange(1500.0), np.arange(1500.0)[::-1]], np.zeros(3000),
    np.arange(3000.0) % 2, np.r_[np.zeros(2900), np.arange(100.0)], np.random.default_rng(0).normal(size=3000)],
    ids=['up', 'down', 'up and down', 'equal', 'two', 'mostly equal', 'any'])
def test_select_of_many(values: np.ndarray):
    for rank in (0, 1, 700, 1500, 2950, 2999):
        ordered = values.copy()
        assert select(ordered, rank) == np.sort(values)[rank]
        assert (ordered[:rank] <= ordered[rank]).all() and (ordered[rank:] >= ordered[rank]).all()
        np.testing.assert_array_equal(np.sort(ordered), np.sort(values))
