"""Parts of one plain body: a long roof has points at its ends only, and looks half a second later as it did before.

That its ends are one thing shows in a single picture: both touch a plain region that does not reach beyond them. The
ground between two vehicles goes on beside them.
"""

from __future__ import annotations

from collections.abc import Sequence

import cv2
import numpy as np
import numpy.typing as npt

from motion_detect_ros.core.geometry.order_statistics import grouped_medians
from motion_detect_ros.core.kernels import kernel
from motion_detect_ros.core.trajectories.alike import inner_motion, moved_as_one_body
from motion_detect_ros.core.trajectories.linked_groups import linked_groups
from motion_detect_ros.core.trajectories.object_motion import PointMotion
from motion_detect_ros.core.types import BoolArray, ByteArray, DoubleArray, FloatArray

#: Plain: the grey values of 3 x 3 pixels of the halved image differ by less than this.
PLAIN_GRAY, WINDOW = 16, np.ones((3, 3), np.uint8)
#: A point touches the regions within so many pixels of the halved image along both axes; more than that in the image.
REACH, NEAR_PX = 2, 8.0
WINDOW_PX = 2 * REACH + 1
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
        count, self._labels = cv2.connectedComponents(plain.view(np.uint8), connectivity=4)
        self._low, self._high = np.full((count, 2), np.inf), np.zeros((count, 2))
        _bounds(self._labels, self._low, self._high)  # OpenCV's statistics take twice as long as its labels
        self._small = (self._high - self._low).max(axis=1) <= largest_px
        self._small[0] = False

    def touched(self, places: FloatArray) -> Numbers:
        """(n, 2) which point touches which region, each pair once. places: (N, 2) pixels of the image."""
        pairs = np.empty((len(places) * WINDOW_PX ** 2, 2), np.intp)
        return pairs[:_touched(self._labels, self._small, places, pairs)]

    def within(self, region: Numbers, low: FloatArray, high: FloatArray) -> BoolArray:
        """(n,) whether regions (n,) reach at most ``BEYOND_PX`` beyond bounds (n, 2) each, pixels of the image."""
        inside: BoolArray = np.all((self._low[region] >= low - BEYOND_PX) & (self._high[region] <= high + BEYOND_PX),
                                   axis=1)
        return inside

    def touching(self, region: int, places: FloatArray) -> int:
        """How many of the points (N, 2) touch it."""
        return int(_touching(self._labels, region, places, self._low[region] - NEAR_PX, self._high[region] + NEAR_PX))


@kernel()
def _bounds(labels, low, high):  # type: ignore[no-untyped-def]
    """Pixels of the image, twice the size of ``labels``; high: exclusive. low: (regions, 2) infinite, high: zeros."""
    rows, columns = labels.shape
    for r in range(rows):
        before = 0
        for c in range(columns):
            label = labels[r, c]
            if label != before:
                high[before, 0] = max(high[before, 0], 2.0 * c)
                low[label, 0], low[label, 1] = min(low[label, 0], 2.0 * c), min(low[label, 1], 2.0 * r)
                high[label, 1] = 2.0 * (r + 1)
                before = label
        high[before, 0] = 2.0 * columns


@kernel()
def _window(place, size):  # type: ignore[no-untyped-def]
    """First and last pixel, exclusive, that a place of the image touches along an axis of its half."""
    at = int(np.rint(place)) // 2
    last = size - 1
    return min(max(at - REACH, 0), last), min(max(at + REACH, 0), last) + 1


@kernel()
def _touched(labels, small, places, pairs):  # type: ignore[no-untyped-def]
    count = 0
    for point in range(len(places)):
        first = count
        left, right = _window(places[point, 0], labels.shape[1])
        top, bottom = _window(places[point, 1], labels.shape[0])
        for r in range(top, bottom):
            for c in range(left, right):
                label = labels[r, c]
                if small[label]:
                    known = first
                    while known < count and pairs[known, 1] != label:
                        known += 1
                    if known == count:
                        pairs[count, 0], pairs[count, 1] = point, label
                        count += 1
    return count


@kernel()
def _touching(labels, region, places, low, high):  # type: ignore[no-untyped-def]
    """low, high: bounds of points that may touch it."""
    count = 0
    for x, y in places:
        if x >= low[0] and y >= low[1] and x <= high[0] and y <= high[1]:
            touches = False
            (left, right), (top, bottom) = _window(x, labels.shape[1]), _window(y, labels.shape[0])
            for r in range(top, bottom):
                for c in range(left, right):
                    touches |= labels[r, c] == region
            count += touches
    return count


def joined_parts(
    parts: Sequence[Numbers], places: FloatArray, still: FloatArray, motion: PointMotion, half: ByteArray,
    largest_px: float,
) -> list[Numbers]:
    """The parts, joined where two that moved as one body touch a plain region that does not reach beyond them.

    parts: indices of ``MIN_PART`` points and more each; places: (N, 2) of all points, still: (m, 2) of those that
    stand, pixels; half: (h, w) the image at half its size; largest_px: longest side of what is joined, pixels.
    """
    if len(parts) < 2:
        return [*parts]
    owner = np.repeat(np.arange(len(parts)), [len(part) for part in parts])
    members = np.concatenate(parts)
    moving, regions = places[members], PlainRegions(half, largest_px)
    links = _neighbours(regions, owner, moving, largest_px)
    used = np.unique(links[:, 1:])
    centres = np.stack([np.bincount(owner, weights=along) for along in moving.T], axis=1) / np.bincount(owner)[:, None]
    typical = _typical(motion.displacements, parts, used)
    of_used = np.isin(owner, used)
    inner = inner_motion([ways[members[of_used]] for ways in motion.displacements], moving[of_used], owner[of_used],
                         len(parts))
    links = links[moved_as_one_body(typical, inner, motion.seconds, centres, links[:, 1:])]
    painted = [number for number in np.unique(links[:, 0]).tolist()
               if regions.touching(number, still) > STILL_SHARE * regions.touching(number, moving)]
    links = links[~np.isin(links[:, 0], painted), 1:]
    return [np.concatenate([parts[number] for number in group]) for group in linked_groups(len(parts), links)]


def _neighbours(regions: PlainRegions, owner: Numbers, places: FloatArray, largest_px: float) -> Numbers:
    """(n, 3) regions and two parts that have each between them. owner: (N,) parts of the points at places (N, 2)."""
    count = owner[-1] + 1
    starts = np.searchsorted(owner, np.arange(count))
    low, high = np.minimum.reduceat(places, starts), np.maximum.reduceat(places, starts)
    point, region = regions.touched(places).T
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


def _typical(
    displacements: Sequence[DoubleArray], parts: Sequence[Numbers], used: Numbers,
) -> list[DoubleArray]:
    """(P, 2) median displacement of each used part over each baseline, NaN where it is too young."""
    typical = [np.full((len(parts), 2), np.nan) for _ in displacements]
    if not len(used):
        return typical
    members = np.concatenate([parts[number] for number in used.tolist()])
    owner = np.repeat(used, [len(parts[number]) for number in used.tolist()])
    size = np.bincount(owner)
    for displacement, medians in zip(displacements, typical, strict=True):
        ways = displacement[members]
        known = np.isfinite(ways[:, 0])
        count = np.bincount(owner[known], minlength=len(size))
        enough = (count >= OLD_SHARE * size) & (count > 0)
        if enough.any():
            medians[np.flatnonzero(enough)] = grouped_medians(ways[known & enough[owner]], count[enough])
    return typical
