"""Corner response of parts of an image, against OpenCV's of the whole image."""

from __future__ import annotations

import cv2
import numpy as np
import pytest

from motion_detect_ros.core.trajectories.corner_response import corner_response, scratch


@pytest.mark.parametrize(('top', 'bottom', 'left', 'right'), [
    (3, 19, 3, 19), (40, 45, 51, 56), (20, 36, 61, 77), (55, 57, 30, 46), (10, 11, 10, 11)])
def test_the_response_of_a_part_is_that_of_the_whole_image(top: int, bottom: int, left: int, right: int) -> None:
    noise = np.random.default_rng(2).integers(0, 256, (60, 80), np.uint8)
    gray = cv2.GaussianBlur(noise, (5, 5), 1.0)
    products, response = scratch(16)
    corner_response(gray, top, bottom, left, right, products, response)
    expected = cv2.cornerMinEigenVal(gray, 5, ksize=3)[top:bottom, left:right]
    np.testing.assert_allclose(response[:bottom - top, :right - left], expected, rtol=1e-4, atol=1e-7)


def test_full_contrast_does_not_overflow() -> None:
    board = np.kron(np.indices((8, 10)).sum(axis=0) % 2, np.ones((8, 8))).astype(np.uint8) * 255
    products, response = scratch(16)
    corner_response(board, 24, 40, 32, 48, products, response)
    np.testing.assert_allclose(response, cv2.cornerMinEigenVal(board, 5, ksize=3)[24:40, 32:48], rtol=1e-4, atol=1e-6)
