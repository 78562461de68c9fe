"""Pyramids against the published kernel, SciPy and themselves backwards."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy import ndimage

from motion_detect_ros.core.errors import FrameError
from motion_detect_ros.core.preprocessing.alternatives.pyramids import (
    expand,
    gaussian_pyramid,
    laplacian_pyramid,
    reconstruct,
    reduce,
)

BINOMIAL = np.array([1.0, 4.0, 6.0, 4.0, 1.0]) / 16.0


def random_image(rows: int, columns: int, seed: int = 0) -> np.ndarray:
    return np.random.default_rng(seed).uniform(0, 255, (rows, columns)).astype(np.float32)


@settings(max_examples=60, deadline=None)
@given(st.integers(1, 70), st.integers(1, 70), st.integers(0, 6), st.integers(0, 2 ** 31))
def test_reconstruction_is_exact_to_rounding(rows, columns, levels, seed):
    image = random_image(rows, columns, seed)
    pyramid = laplacian_pyramid(image, levels)
    np.testing.assert_allclose(reconstruct(pyramid), image, atol=1e-3)
    assert [level.dtype for level in pyramid] == [np.float32] * len(pyramid)


@pytest.mark.parametrize('shape', [(64, 48), (65, 47), (17, 32)])
def test_reduce_is_the_binomial_kernel_and_every_second_pixel(shape):
    image = random_image(*shape)
    smooth = ndimage.convolve(image.astype(float), np.outer(BINOMIAL, BINOMIAL), mode='mirror')
    np.testing.assert_allclose(reduce(image), smooth[::2, ::2], atol=1e-3)


@pytest.mark.parametrize('shape', [(64, 48), (65, 47)])
def test_expand_is_four_times_the_kernel_on_spread_pixels(shape):
    small = random_image(-(-shape[0] // 2), -(-shape[1] // 2))
    spread = np.zeros(shape)
    spread[::2, ::2] = small
    expected = 4.0 * ndimage.convolve(spread, np.outer(BINOMIAL, BINOMIAL), mode='constant')
    inside = np.s_[4:-4, 4:-4]
    np.testing.assert_allclose(expand(small, shape)[inside], expected[inside], atol=1e-3)


def test_sizes_are_halved_and_rounded_up():
    shapes = [level.shape for level in gaussian_pyramid(random_image(37, 50), 3)]
    assert shapes == [(37, 50), (19, 25), (10, 13), (5, 7)]


@pytest.mark.parametrize(('least', 'sides'), [(1, [37, 19, 10, 5, 3, 2, 1]), (5, [37, 19, 10, 5]), (6, [37, 19, 10])])
def test_no_level_is_smaller_than_asked_for(least, sides):
    assert [level.shape[0] for level in gaussian_pyramid(random_image(37, 50), 9, least)] == sides


def test_a_ramp_has_no_detail():
    """The kernel keeps what is linear; only the border mirrors."""
    y, x = np.mgrid[:64, :80].astype(np.float32)
    for detail in laplacian_pyramid(2.0 * x + y, 2)[:-1]:
        assert np.abs(detail[6:-6, 6:-6]).max() < 1e-3


def test_what_is_left_of_a_wave_is_what_the_kernel_s_spectrum_says():
    """A frequency w passes REDUCE and EXPAND with cos(w / 2)^8; the detail has the rest."""
    _, x = np.mgrid[:128, :128]
    for length in (2, 12, 16, 32):
        wave = (100 * np.cos(2 * np.pi * x / length)).astype(np.float32)
        detail = laplacian_pyramid(wave, 1)[0][8:-8, 8:-8]
        left = 1.0 - np.cos(np.pi / length) ** 8
        assert detail.std() / wave[8:-8, 8:-8].std() == pytest.approx(left, abs=0.01)


def test_bytes_are_taken_too():
    image = np.random.default_rng(0).integers(0, 255, (33, 40)).astype(np.uint8)
    np.testing.assert_allclose(reconstruct(laplacian_pyramid(image, 3)), image, atol=1e-3)


@pytest.mark.parametrize('shape', [(10, 10, 3), (0, 10), (5,)])
def test_anything_but_a_grey_image_is_refused(shape):
    with pytest.raises(FrameError, match='expected a grey image of shape'):
        gaussian_pyramid(np.zeros(shape, np.float32), 2)
