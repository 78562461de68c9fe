"""Which of the motions that tracks agree on is the background's: the one that most of the picture goes with.

Corners are strong where there is texture: of a road full of vehicles they are those of the vehicles, and the largest
group that goes alike is one direction of the traffic.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace

import numpy as np

from motion_detect_ros.core.ego_motion.agreement import shows_rather
from motion_detect_ros.core.ego_motion.measurement import MIN_TRACKS, centre_of, is_plausible
from motion_detect_ros.core.ego_motion.robust_fit import MotionFit, refine_motion
from motion_detect_ros.core.geometry.motion_models import ModelFamily, matrix_theta, theta_matrix
from motion_detect_ros.core.geometry.warp import apply
from motion_detect_ros.core.types import NANOSECONDS, DoubleArray, FloatArray, PreparedFrame

#: A motion that this share of the tracks goes with has no rival; a rival has this share at least, so many are tried.
UNDISPUTED_SHARE, RIVAL_SHARE, MOST_RIVALS = 0.6, 0.05, 4
#: Where there was none, nor has been for so long, it looks again after as long, seconds.
AGAIN_S = 0.5
#: Tracks whose ways differ by less than about this many times the threshold are one group.
GROUP = 1.5


class RivalMotions:
    """Looks for the background among the groups of tracks, where no group is most of them.

    A scene in depth has such tracks in every frame, and no rival: there it looks now and then only.
    """

    def __init__(self) -> None:
        self._won_ns: int | None = None
        self._in_vain_ns: int | None = None

    def background(
        self, fit: MotionFit, family: ModelFamily, earlier: FloatArray, later: FloatArray, threshold_px: float,
        previous: PreparedFrame, frame: PreparedFrame,
    ) -> MotionFit:
        """``fit``, or the motion of other tracks that clearly more of the picture goes with.

        earlier, later: (N, 2) full-resolution pixels; threshold_px: up to which a track goes with a motion.
        """
        centre, best = centre_of(frame), fit
        away = np.hypot(*_off(theta_matrix(fit.theta, centre), earlier, later).T)
        idle = _short_before(self._in_vain_ns, frame) and not _short_before(self._won_ns, frame)
        if idle or (away <= threshold_px).mean() >= UNDISPUTED_SHARE:
            return fit
        for rival in _rivals(family, earlier, later, threshold_px, centre):
            if shows_rather(previous, frame, theta_matrix(rival.theta, centre), theta_matrix(best.theta, centre)):
                best = rival
        if best is fit:
            self._in_vain_ns = frame.stamp_ns
        else:
            self._won_ns = frame.stamp_ns
        return best


def _short_before(stamp_ns: int | None, frame: PreparedFrame) -> bool:
    return stamp_ns is not None and abs(frame.stamp_ns - stamp_ns) < AGAIN_S * NANOSECONDS


def _rivals(
    family: ModelFamily, earlier: FloatArray, later: FloatArray, threshold_px: float, centre: DoubleArray,
) -> Iterator[MotionFit]:
    """The motions of the groups of tracks that are shifted alike against the most common motion, the largest first.

    The camera turns and zooms for all alike: what drives is shifted against the ground.
    """
    start = family.start(earlier, later, threshold_px)
    if start is None or not np.isfinite(start).all():
        return
    off = _off(start, earlier, later)
    left = np.ones(len(earlier), np.bool_)
    for _ in range(MOST_RIVALS):
        shift = _most_common(off[left], GROUP * threshold_px)
        own = left & (np.hypot(*(off - shift).T) <= GROUP * threshold_px)
        if own.sum() < max(MIN_TRACKS, RIVAL_SHARE * len(earlier)):
            return
        left &= ~own
        theta = matrix_theta(start, centre)
        theta[[0, 3]] += shift
        fit = refine_motion(family, earlier[own], later[own], theta, centre)
        if fit is not None and is_plausible(fit, centre):
            inliers = np.zeros(len(earlier), np.bool_)
            inliers[own] = fit.inliers
            yield replace(fit, inliers=inliers)
        if left.sum() < MIN_TRACKS:
            return


def _most_common(off: DoubleArray, side_px: float) -> DoubleArray:
    """(2,) median of the vectors, (N, 2), in the fullest square of this side."""
    _, owner, sizes = np.unique(np.floor(off / side_px + 0.5), axis=0, return_inverse=True, return_counts=True)
    return np.asarray(np.median(off[owner.ravel() == np.argmax(sizes)], axis=0), np.float64)


def _off(matrix: DoubleArray, earlier: FloatArray, later: FloatArray) -> DoubleArray:
    """(N, 2) how far tracks end from where a (3, 3) warp takes their start."""
    return np.asarray(later - apply(matrix, earlier), np.float64)
