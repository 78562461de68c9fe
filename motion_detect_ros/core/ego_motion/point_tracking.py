"""Point tracking: pyramidal Lucas-Kanade (Bouguet 2001), forward-backward checked."""

from __future__ import annotations

import cv2
import numpy as np

from motion_detect_ros.core.config import EgoMotionConfig
from motion_detect_ros.core.geometry.lucas_kanade import lucas_kanade
from motion_detect_ros.core.geometry.warp import apply, inverse
from motion_detect_ros.core.types import BoolArray, ByteArray, DoubleArray, FloatArray

#: Every sixth point is a seed point, tracked over the whole pyramid; least number of seed points.
SEED_STRIDE, MIN_SEEDS = 6, 20
#: RANSAC threshold of the seed points, pixels: what the tracker corrects without a pyramid.
AGREEMENT_PX = 3.0
#: Fewer failed points than this, share of all, are let go: the others tell the motion, and a pyramid costs as much for
#: one point as for hundreds.
RETRIED_SHARE = 0.5


def track_points(
    previous: ByteArray, current: ByteArray, points: FloatArray, config: EgoMotionConfig,
    prior: DoubleArray | None = None,
) -> tuple[FloatArray, BoolArray]:
    """(N, 2) float32 positions of ``points`` in ``current``, and (N,) bool which pass the forward-backward check.

    previous, current: (h, w) uint8 of the same size; points: (N, 2) float32 pixels of these images; prior: (3, 3)
    initial guess, previous pixel -> current pixel, None = identity. Seed points give the common motion, from which
    the others are tracked without a pyramid. Points that fail, on moving objects or at another depth, are tracked
    over the whole pyramid where they are over ``RETRIED_SHARE`` of all.
    Source: Bouguet 2001; forward-backward check: Kalal et al. 2010.
    """
    common = _common_motion(previous, current, points, config, prior)
    if common is None:
        return _both_ways(previous, current, points, config, prior, config.pyramid_levels)
    moved, good = track_close(previous, current, points, config, common)
    if np.count_nonzero(~good) > RETRIED_SHARE * len(points):
        moved[~good], good[~good] = _both_ways(previous, current, points[~good], config, prior, config.pyramid_levels)
    return moved, good


def track_close(
    previous: ByteArray, current: ByteArray, points: FloatArray, config: EgoMotionConfig, motion: DoubleArray,
) -> tuple[FloatArray, BoolArray]:
    """As ``track_points``, without a pyramid, for points within a few pixels of ``motion``.

    motion: (3, 3) previous pixel -> current pixel, of the images as given.
    """
    return _both_ways(previous, current, points, config, motion, 0)


def _common_motion(
    previous: ByteArray, current: ByteArray, points: FloatArray, config: EgoMotionConfig, prior: DoubleArray | None,
) -> DoubleArray | None:
    """(3, 3) affine that most seed points agree on; None where there are too few of them."""
    seeds = np.ascontiguousarray(points[::SEED_STRIDE])
    if len(seeds) < MIN_SEEDS:
        return None
    moved, found = _one_way(
        previous, current, seeds, config, None if prior is None else apply(prior, seeds), config.pyramid_levels)
    if found.sum() < MIN_SEEDS:
        return None
    affine, _ = cv2.estimateAffine2D(
        seeds[found], moved[found], method=cv2.RANSAC, ransacReprojThreshold=AGREEMENT_PX)
    if affine is None or abs(np.linalg.det(affine[:, :2])) < 0.5:
        return None
    return np.vstack([affine, [0.0, 0.0, 1.0]])


def _both_ways(
    previous: ByteArray, current: ByteArray, points: FloatArray, config: EgoMotionConfig,
    prior: DoubleArray | None, levels: int,
) -> tuple[FloatArray, BoolArray]:
    """Backward tracking starts from the inverse of the prior, not from ``points``: else it confirms occluded points."""
    there, found = _one_way(
        previous, current, points, config, None if prior is None else apply(prior, points), levels)
    back, found_back = _one_way(
        current, previous, there, config, None if prior is None else apply(inverse(prior), there), levels)
    away = back - points
    with np.errstate(invalid='ignore', over='ignore'):
        near = away[:, 0] ** 2 + away[:, 1] ** 2 < config.forward_backward_px ** 2
    return there, found & found_back & near


def _one_way(
    one: ByteArray, other: ByteArray, points: FloatArray, config: EgoMotionConfig,
    guess: FloatArray | None, levels: int,
) -> tuple[FloatArray, BoolArray]:
    """levels: of the pyramid above the images themselves."""
    window = (config.lk_window_px, config.lk_window_px)
    flags = 0 if guess is None else cv2.OPTFLOW_USE_INITIAL_FLOW
    moved, found, _ = lucas_kanade(one, other, points, guess, {'winSize': window, 'maxLevel': levels, 'flags': flags})
    return moved, found.ravel() > 0
