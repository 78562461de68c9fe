"""Connected regions of what was not there before: where an object ends, which points tell within their windows only.

A pixel changed that differs from what was at its place and beside it half a second and a second ago. What moves its own
length in that time stands out whole. At half of the working resolution.
"""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np
import numpy.typing as npt

from motion_detect_ros.core.geometry.boxes import shared_areas
from motion_detect_ros.core.trajectories.changes import CHANGED_GRAY, long_ago
from motion_detect_ros.core.trajectories.recent_frames import RecentFrames
from motion_detect_ros.core.types import BoolArray, ByteArray, DoubleArray

#: Pixels beside one, of the halved image: the ego-motion and the warp err by less.
BESIDE = cv2.getStructuringElement(cv2.MORPH_CROSS, (3, 3))
#: Gaps that are closed, and fewest pixels of a region, both of the halved image.
CLOSING, LEAST_PIXELS = np.ones((3, 3), np.uint8), 3
#: A region is one body where it fills this share of its box.
BODY_FILL = 0.6
#: A box is in a region's box with this share of its area.
INSIDE_SHARE = 0.6

Numbers = npt.NDArray[np.intp]


@dataclass(frozen=True)
class ChangedRegions:
    """``low``, ``high``: (R, 2) edges of the boxes of R regions, pixels of the working resolution; ``fill``: (R,) share
    of its box that each covers; ``seconds``: since the later one of the earlier frames.
    """

    low: DoubleArray
    high: DoubleArray
    fill: DoubleArray
    seconds: float

    @classmethod
    def of(cls, frames: RecentFrames, mask: BoolArray | None) -> ChangedRegions:
        """Those of the current one of ``frames``; none with too short a history.

        mask: (h, w), False = not the scene; None = nowhere.
        """
        changed = _changed(frames)
        if mask is not None:
            changed &= mask[::2, ::2].view(np.uint8)
        closed = cv2.morphologyEx(changed, cv2.MORPH_CLOSE, CLOSING)
        _, _, figures, _ = cv2.connectedComponentsWithStats(closed, connectivity=8)
        figures = figures[1:][figures[1:, cv2.CC_STAT_AREA] >= LEAST_PIXELS]
        low, size = figures[:, :2].astype(np.float64), figures[:, 2:4].astype(np.float64)
        return cls(2.0 * low, 2.0 * (low + size), figures[:, cv2.CC_STAT_AREA] / size.prod(axis=1),
                   frames.seconds(long_ago(frames)[0]))

    def most_alike(self, low: DoubleArray, high: DoubleArray) -> tuple[Numbers, DoubleArray]:
        """(N,) the region whose box is most like each of N boxes, and (N,) their intersection over union; 0, 0 without
        any region.

        low, high: (N, 2) pixels.
        """
        if not len(self.low):
            return np.zeros(len(low), np.intp), np.zeros(len(low))
        shared = shared_areas((low, high), (self.low, self.high))
        areas, own = (high - low).prod(axis=1), (self.high - self.low).prod(axis=1)
        iou = shared / (areas[:, None] + own - shared)
        best = iou.argmax(axis=1)
        return best, iou[np.arange(len(best)), best]

    def without_tail(
        self, region: int, low: DoubleArray, high: DoubleArray, velocity: DoubleArray,
    ) -> tuple[DoubleArray, DoubleArray]:
        """(2,) edges of a region's box less the ground behind the object in it, which that covered both times.

        low, high: (2,) the object's edges, pixels; velocity: (2,) against the background, pixels/s.
        """
        way = velocity * self.seconds
        tail = np.minimum(np.abs(way), np.maximum(0.0, high - low - np.abs(way)))
        edge_low, edge_high = self.low[region], self.high[region]
        return (np.where(way > 0.0, np.maximum(edge_low, np.minimum(edge_low + tail, low)), edge_low),
                np.where(way < 0.0, np.minimum(edge_high, np.maximum(edge_high - tail, high)), edge_high))

    def bodies(self, low: DoubleArray, high: DoubleArray) -> list[tuple[int, Numbers]]:
        """Regions that are one body, each with the numbers of the boxes that are parts of it: two or more in a compact
        region, some of which overlap.

        Neighbours whose regions touch, by their shadows, have boxes side by side. low, high: (N, 2) pixels.
        """
        inside = shared_areas((low, high), (self.low, self.high)) > INSIDE_SHARE * (high - low).prod(axis=1)[:, None]
        overlap = shared_areas((low, high), (low, high)) > 0.0
        np.fill_diagonal(overlap, False)
        found, taken = list[tuple[int, Numbers]](), np.zeros(len(low), np.bool_)
        for region in np.flatnonzero((self.fill >= BODY_FILL) & (inside.sum(axis=0) > 1)).tolist():
            parts = np.flatnonzero(inside[:, region] & ~taken)
            if overlap[np.ix_(parts, parts)].any():
                taken[parts] = True
                found.append((region, parts))
        return found


def _changed(frames: RecentFrames) -> ByteArray:
    """(ceil(h / 2), ceil(w / 2)) 1 where the current frame differs from both earlier ones, and 0."""
    current, earlier = frames[0].half, long_ago(frames)
    if len(earlier) < 2:  # differences from a single one are as much of what has gone
        return np.zeros(current.shape, np.uint8)
    least: ByteArray = np.full(current.shape, 255, np.uint8)
    for ago in earlier:
        before = frames.earlier_half(ago)
        brighter = cv2.subtract(current, cv2.dilate(before, BESIDE))
        darker = cv2.subtract(cv2.erode(before, BESIDE), current)
        least = cv2.min(least, cv2.max(brighter, darker))
    return (least > CHANGED_GRAY).view(np.uint8)
