"""Point tracking: pyramidal Lucas-Kanade (Bouguet 2001), forward-backward checked."""

from __future__ import annotations

from typing import NamedTuple

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


class Tracks(NamedTuple):
    """``moved``: (N, 2) float32 where points went, pixels; ``good``: (N,) bool, which passed the forward-backward
    check; ``error``: (N,) float32 mean difference of their windows in the two images, grey levels.
    """

    moved: FloatArray
    good: BoolArray
    error: FloatArray


def track_points(
    previous: ByteArray, current: ByteArray, points: FloatArray, config: EgoMotionConfig,
    prior: DoubleArray | None = None, retry_all: bool = False,
) -> Tracks:
    """Where ``points`` are in ``current``.

    previous, current: (h, w) uint8 of the same size; points: (N, 2) float32 pixels of these images; prior: (3, 3)
    initial guess, previous pixel -> current pixel, None = identity. Seed points give the common motion, from which
    the others are tracked without a pyramid. Points that fail, on moving objects or at another depth, are tracked
    over the whole pyramid where they are over ``RETRIED_SHARE`` of all, with ``retry_all`` however few they are.
    Source: Bouguet 2001; forward-backward check: Kalal et al. 2010.
    """
    common = _common_motion(previous, current, points, config, prior)
    if common is None:
        return _both_ways(previous, current, points, config, prior, config.pyramid_levels)
    tracks = track_close(previous, current, points, config, common)
    failed = np.flatnonzero(~tracks.good)
    if len(failed) and (retry_all or not most_good(tracks)):
        again = _both_ways(previous, current, points[failed], config, prior, config.pyramid_levels)
        for each, new in zip(tracks, again, strict=True):
            each[failed] = new
    return tracks


def most_good(tracks: Tracks) -> bool:
    """Whether no more than ``RETRIED_SHARE`` of the points failed."""
    return bool(np.count_nonzero(~tracks.good) <= RETRIED_SHARE * len(tracks.good))


def track_close(
    previous: ByteArray, current: ByteArray, points: FloatArray, config: EgoMotionConfig, motion: DoubleArray,
) -> Tracks:
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
    moved, found, _ = _one_way(
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
) -> Tracks:
    """Backward tracking starts from the inverse of the prior, not from ``points``: else it confirms occluded points."""
    there, found, error = _one_way(
        previous, current, points, config, None if prior is None else apply(prior, points), levels)
    back, found_back, _ = _one_way(
        current, previous, there, config, None if prior is None else apply(inverse(prior), there), levels)
    away = back - points
    with np.errstate(invalid='ignore', over='ignore'):
        near = away[:, 0] ** 2 + away[:, 1] ** 2 < config.forward_backward_px ** 2
    return Tracks(there, found & found_back & near, error)


def _one_way(
    one: ByteArray, other: ByteArray, points: FloatArray, config: EgoMotionConfig,
    guess: FloatArray | None, levels: int,
) -> Tracks:
    """``good``: which were found; levels: of the pyramid above the images themselves."""
    window = (config.lk_window_px, config.lk_window_px)
    flags = 0 if guess is None else cv2.OPTFLOW_USE_INITIAL_FLOW
    moved, found, error = lucas_kanade(
        one, other, points, guess, {'winSize': window, 'maxLevel': levels, 'flags': flags})
    return Tracks(moved, found.ravel() > 0, error.ravel())
