"""Means over cells, and images shrunk by whole numbers, against sums in NumPy."""

from __future__ import annotations

import numpy as np
import pytest

from motion_detect_ros.core.geometry.resizing import averaged, shrunk


def shares(size: int, cells: int) -> np.ndarray:
    """(cells, size) how much of each pixel belongs to each of ``cells`` equal parts."""
    edges = np.linspace(0.0, size, cells + 1)
    low, high = np.arange(size), np.arange(1, size + 1)
    overlap = np.minimum(edges[1:, None], high) - np.maximum(edges[:-1, None], low)
    return np.clip(overlap, 0.0, 1.0)


@pytest.mark.parametrize('size', [(32, 64), (30, 64), (32, 61), (30, 61), (290, 960)])
@pytest.mark.parametrize('channels', [(), (2,)])
def test_means_over_cells_are_weighted_by_the_pixels_shares(size: tuple[int, int], channels: tuple[int, ...]) -> None:
    values = np.random.default_rng(1).normal(size=(*size, *channels)).astype(np.float32)
    rows, columns = round(size[0] / 8), round(size[1] / 8)
    down, across = shares(size[0], rows), shares(size[1], columns)
    expected = np.einsum('ri,ck,ik...->rc...', down, across, values) * (rows * columns / (size[0] * size[1]))
    found = averaged(values, rows, columns)
    assert (found.shape, found.dtype) == ((rows, columns, *channels), np.float32)
    np.testing.assert_allclose(found, expected, atol=1e-5)


@pytest.mark.parametrize(('size', 'factor'), [
    ((270, 480), 3), ((271, 485), 3), ((40, 239), 1), ((30, 60), 1), ((2, 640), 4)])
def test_images_are_shrunk_by_a_whole_number_to_about_a_width(size: tuple[int, int], factor: int) -> None:
    gray = np.random.default_rng(2).integers(0, 256, size, np.uint8)
    small, scale = shrunk(gray, 160)
    rows, columns = max(1, size[0] // factor), size[1] // factor
    assert (scale, small.shape) == (1.0 / factor, (rows, columns))
    if size[0] >= factor:
        cells = gray[:rows * factor, :columns * factor].reshape(rows, factor, columns, factor).astype(float)
        assert np.abs(small - cells.mean(axis=(1, 3))).max() <= 0.5
