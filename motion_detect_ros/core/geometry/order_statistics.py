"""Median and percentiles for numba kernels: NumPy's own take seconds to compile."""

from __future__ import annotations

import numpy as np

from motion_detect_ros.core.kernels import kernel
from motion_detect_ros.core.types import DoubleArray, FloatArray


@kernel()
def median(values):  # type: ignore[no-untyped-def]
    """As ``numpy.median`` of ``values`` (n,), n > 0, in their type; reorders them. NaN is not handled."""
    middle = len(values) // 2
    high = select(values, middle)
    if len(values) % 2:
        return high
    low = values[0]
    for n in range(1, middle):
        low = max(low, values[n])
    return low + (high - low) / 2


def column_medians(values: FloatArray | DoubleArray) -> DoubleArray:
    """As ``numpy.median(values, axis=0)``, (m,) float64, of ``values`` (n, m), n > 0; NaN is not handled."""
    return np.array([median(column) for column in np.array(values.T, order='C')], np.float64)


@kernel()
def percentile(values, percent):  # type: ignore[no-untyped-def]
    """As ``numpy.percentile`` of ``values`` (n,) float32, n > 0; reorders them."""
    rank = percent / 100.0 * (len(values) - 1)
    below = int(rank)
    low = select(values, below)
    high = low
    for n in range(below + 1, len(values)):
        high = values[n] if n == below + 1 else min(high, values[n])
    return low + np.float32(rank - below) * (high - low)


@kernel()
def select(values, rank):  # type: ignore[no-untyped-def]
    """The ``rank``-th smallest of (n,) values; partitions them in place: none before it is larger, none after smaller.

    Source: Hoare 1961, algorithm 65.
    """
    first, last = 0, len(values) - 1
    while first < last:
        pivot, i, j = values[(first + last) // 2], first, last
        while i <= j:
            while values[i] < pivot:
                i += 1
            while values[j] > pivot:
                j -= 1
            if i <= j:
                values[i], values[j] = values[j], values[i]
                i, j = i + 1, j - 1
        first, last = (first if rank <= j else i), (last if rank >= i else j)
        if j < rank < i:
            break
    return values[rank]
