"""Parts of one plain body: a long roof has points at its ends only, and looks half a second later as it did before.

That its ends are one thing shows in a single picture: both touch a plain region that does not reach beyond them. The
ground between two vehicles goes on beside them.
"""

from __future__ import annotations

from collections.abc import Sequence

import cv2
import numpy as np
import numpy.typing as npt

from motion_detect_ros.core.geometry.order_statistics import column_medians
from motion_detect_ros.core.trajectories.alike import moved_as_one_body
from motion_detect_ros.core.trajectories.linked_groups import linked_groups
from motion_detect_ros.core.trajectories.object_motion import BASELINES_S
from motion_detect_ros.core.types import BoolArray, ByteArray, DoubleArray, FloatArray

#: Plain: the grey values of 3 x 3 pixels of the halved image differ by less than this.
PLAIN_GRAY, WINDOW = 16, np.ones((3, 3), np.uint8)
#: A point touches the regions within so many pixels of the halved image along both axes; more than that in the image.
REACH, NEAR_PX = np.arange(-2, 3), 8.0
#: A region may reach so many pixels beyond the points that touch it.
BEYOND_PX = 6.0
#: Still points that touch a region, at most, share of the moving ones: more of them, and it is a part of the scene.
STILL_SHARE = 0.5
#: Fewest points of a part; share of them that must be as old as a baseline for the part's displacement over it.
MIN_PART, OLD_SHARE = 3, 0.5

Numbers = npt.NDArray[np.intp]


class PlainRegions:
    """Connected plain regions of an image, of a limited size."""

    def __init__(self, half: ByteArray, largest_px: float) -> None:
        """half: (h, w), the image at half its size; largest_px: longest side of a region, pixels of the image."""
        plain = cv2.subtract(cv2.dilate(half, WINDOW), cv2.erode(half, WINDOW)) < PLAIN_GRAY
        _, self._labels, stats, _ = cv2.connectedComponentsWithStats(plain.view(np.uint8), connectivity=4)
        self._low, self._high = 2.0 * stats[:, :2], 2.0 * (stats[:, :2] + stats[:, 2:4])
        self._small = (self._high - self._low).max(axis=1) <= largest_px
        self._small[0] = False

    def touched(self, places: FloatArray) -> tuple[Numbers, Numbers]:
        """Which point touches which region, each pair once. places: (N, 2) pixels of the image."""
        height, width = self._labels.shape
        columns, rows = np.rint(places / 2.0).astype(np.intp).T
        columns, rows = (np.clip(at[:, None] + REACH, 0, last - 1) for at, last in ((columns, width), (rows, height)))
        labels = self._labels[rows[:, :, None], columns[:, None, :]].reshape(len(places), REACH.size ** 2)
        point, place = np.nonzero(self._small[labels])
        both = np.unique(point * len(self._small) + labels[point, place])
        return both // len(self._small), both % len(self._small)

    def within(self, region: Numbers, low: FloatArray, high: FloatArray) -> BoolArray:
        """(n,) whether regions (n,) reach at most ``BEYOND_PX`` beyond bounds (n, 2) each, pixels of the image."""
        inside: BoolArray = ((self._low[region] >= low - BEYOND_PX) & (self._high[region] <= high + BEYOND_PX)
                             ).all(axis=1)
        return inside

    def touching(self, region: int, places: FloatArray) -> int:
        """How many of the points (N, 2) touch it."""
        near = ((places >= self._low[region] - NEAR_PX) & (places <= self._high[region] + NEAR_PX)).all(axis=1)
        return int((self.touched(places[near])[1] == region).sum())


def joined_parts(
    parts: Sequence[Numbers], places: FloatArray, still: FloatArray, displacements: Sequence[DoubleArray],
    half: ByteArray, largest_px: float,
) -> list[Numbers]:
    """The parts, joined where two that moved as one body touch a plain region that does not reach beyond them.

    parts: indices of points each; places: (N, 2) of all points, still: (m, 2) of those that stand, pixels;
    displacements: (N, 2) each, over baselines, longest first, NaN where unknown; half: (h, w) the image at half its
    size; largest_px: longest side of what is joined, pixels.
    """
    parts = [part for part in parts if len(part) >= MIN_PART]
    if len(parts) < 2:
        return parts
    owner = np.repeat(np.arange(len(parts)), [len(part) for part in parts])
    moving, regions = places[np.concatenate(parts)], PlainRegions(half, largest_px)
    links = _neighbours(regions, owner, moving, largest_px)
    used = np.unique(links[:, 1:])
    centres = np.stack([np.bincount(owner, weights=along) for along in moving.T], axis=1) / np.bincount(owner)[:, None]
    typical = [_typical(each, parts, used) for each in displacements]
    links = links[moved_as_one_body(typical, BASELINES_S, centres, links[:, 1:])]
    painted = [number for number in np.unique(links[:, 0]).tolist()
               if regions.touching(number, still) > STILL_SHARE * regions.touching(number, moving)]
    links = links[~np.isin(links[:, 0], painted), 1:]
    return [np.concatenate([parts[number] for number in group]) for group in linked_groups(len(parts), links)]


def _neighbours(regions: PlainRegions, owner: Numbers, places: FloatArray, largest_px: float) -> Numbers:
    """(n, 3) regions and two parts that have each between them. owner: (N,) parts of the points at places (N, 2)."""
    count = owner[-1] + 1
    starts = np.searchsorted(owner, np.arange(count))
    low, high = np.minimum.reduceat(places, starts), np.maximum.reduceat(places, starts)
    point, region = regions.touched(places)
    both = np.unique(region * count + owner[point])
    touched, toucher = both // count, both % count
    found, apart = [np.empty((0, 3), np.intp)], 1
    while (same := np.flatnonzero(touched[apart:] == touched[:-apart])).size:
        shared, one, other = touched[same], toucher[same], toucher[same + apart]
        hull_low, hull_high = np.minimum(low[one], low[other]), np.maximum(high[one], high[other])
        fits = ((hull_high - hull_low).max(axis=1) <= largest_px) & regions.within(shared, hull_low, hull_high)
        found.append(np.stack([shared, one, other], axis=1)[fits])
        apart += 1
    return np.concatenate(found)


def _typical(displacement: DoubleArray, parts: Sequence[Numbers], used: Numbers) -> DoubleArray:
    """(P, 2) median displacement of each used part, NaN where it is too young."""
    typical = np.full((len(parts), 2), np.nan)
    for number in used.tolist():
        known = displacement[parts[number]]
        known = known[np.isfinite(known[:, 0])]
        if len(known) >= OLD_SHARE * len(parts[number]):
            typical[number] = column_medians(known)
    return typical
