"""Against numpy's own."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays

from motion_detect_ros.core.geometry.order_statistics import column_medians, median, percentile, select

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
