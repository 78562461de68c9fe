"""Median and percentiles for numba kernels: NumPy's own take seconds to compile."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

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


def grouped_medians(values: FloatArray | DoubleArray, sizes: npt.NDArray[np.intp]) -> DoubleArray:
    """``column_medians`` of each of (K,) groups of rows of ``values`` (n, m), one after the other, none empty:
    (K, m) float64.
    """
    medians = np.empty((len(sizes), values.shape[1]))
    _medians(np.ascontiguousarray(values), sizes, np.empty(len(values), values.dtype), medians)
    return medians


@kernel()
def _medians(values, sizes, scratch, medians):  # type: ignore[no-untyped-def]
    first = 0
    for group, size in enumerate(sizes):
        for column in range(values.shape[1]):
            for row in range(size):
                scratch[row] = values[first + row, column]
            medians[group, column] = median(scratch[:size])
        first += size


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

    Source: Hoare 1961, algorithm 65; parted as by Lomuto (Bentley 1984), without a branch that depends on the values:
    a wrong guess of the processor costs more than moving one.
    """
    first, last = 0, len(values) - 1
    while first < last:
        pivot = _pivot_to_end(values, first, last)
        low = first
        for n in range(first, last):
            value = values[n]
            values[n], values[low] = values[low], value
            low += value < pivot
        values[last], values[low] = values[low], pivot
        if low == first:  # nothing is smaller: pass over all that are equal
            for n in range(first + 1, last + 1):
                value = values[n]
                values[n], values[low + 1] = values[low + 1], value
                low += value == pivot
            if rank <= low:
                break
        if rank == low:
            break
        first, last = (first, low - 1) if rank < low else (low + 1, last)
    return values[rank]


@kernel()
def _pivot_to_end(values, first, last):  # type: ignore[no-untyped-def]
    """Puts the middle one of three of ``values[first : last + 1]`` at the end and returns it."""
    quarter = (last - first) // 4
    at = first + quarter
    one, two, three = values[at], values[(first + last) // 2], values[last - quarter]
    pivot = max(min(one, two), min(max(one, two), three))
    if pivot != one:
        at = (first + last) // 2 if pivot == two else last - quarter
    values[at], values[last] = values[last], pivot
    return pivot
