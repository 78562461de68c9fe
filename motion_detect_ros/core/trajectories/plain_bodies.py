"""Parts of one plain body: a long roof has points at its ends only, and looks half a second later as it did before.

That its ends are one thing shows in a single picture: both touch a plain region that does not reach beyond them. The
ground between two vehicles goes on beside them.
"""

from __future__ import annotations

from collections.abc import Sequence
from itertools import combinations

import cv2
import numpy as np
import numpy.typing as npt
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components

from motion_detect_ros.core.geometry.order_statistics import column_medians
from motion_detect_ros.core.trajectories.alike import moved_alike
from motion_detect_ros.core.types import ByteArray, DoubleArray, FloatArray

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

    def within(self, region: int, low: FloatArray, high: FloatArray) -> bool:
        """Whether it reaches at most ``BEYOND_PX`` beyond bounds (2,) each, pixels of the image."""
        return bool((self._low[region] >= low - BEYOND_PX).all() and (self._high[region] <= high + BEYOND_PX).all())

    def touching(self, region: int, places: FloatArray) -> int:
        """How many of the points (N, 2) touch it."""
        near = ((places >= self._low[region] - NEAR_PX) & (places <= self._high[region] + NEAR_PX)).all(axis=1)
        return int((self.touched(places[near])[1] == region).sum())


def joined_parts(
    parts: Sequence[Numbers], places: FloatArray, still: FloatArray, displacements: Sequence[DoubleArray],
    half: ByteArray, largest_px: float,
) -> list[Numbers]:
    """The parts, joined where two that moved alike touch a plain region that does not reach beyond them.

    parts: indices of points each; places: (N, 2) of all points, still: (m, 2) of those that stand, pixels;
    displacements: (N, 2) each, over baselines, longest first, NaN where unknown; half: (h, w) the image at half its
    size; largest_px: longest side of what is joined, pixels.
    """
    parts = [part for part in parts if len(part) >= MIN_PART]
    pairs = _neighbours(parts, places, still, PlainRegions(half, largest_px), largest_px) if len(parts) > 1 else []
    if not pairs:
        return parts
    numbers = np.array(pairs, np.intp)
    typical = [_typical(each, parts, np.unique(numbers)) for each in displacements]
    links = numbers[moved_alike(typical, numbers)]
    graph = coo_array((np.ones(len(links)), (links[:, 0], links[:, 1])), shape=(len(parts), len(parts)))
    count, labels = connected_components(graph, directed=False)
    return [np.concatenate([parts[index] for index in np.flatnonzero(labels == label)]) for label in range(count)]


def _neighbours(
    parts: Sequence[Numbers], places: FloatArray, still: FloatArray, regions: PlainRegions, largest_px: float,
) -> list[tuple[int, int]]:
    """Pairs of parts with a plain region between them."""
    bounds = [(places[part].min(axis=0), places[part].max(axis=0)) for part in parts]
    owner = np.repeat(np.arange(len(parts)), [len(part) for part in parts])
    point, region = regions.touched(places[np.concatenate(parts)])
    both, counts = np.unique(region * len(parts) + owner[point], return_counts=True)
    touched, toucher = both // len(parts), both % len(parts)
    found: list[tuple[int, int]] = []
    for shared in np.unique(touched[1:][touched[1:] == touched[:-1]]).tolist():
        there = touched == shared
        pairs = [pair for pair in combinations(toucher[there].tolist(), 2)
                 if _within(regions, shared, bounds, pair, largest_px)]
        if pairs and regions.touching(shared, still) <= STILL_SHARE * counts[there].sum():
            found += pairs
    return found


def _within(
    regions: PlainRegions, region: int, bounds: Sequence[tuple[FloatArray, FloatArray]], pair: tuple[int, int],
    largest_px: float,
) -> bool:
    """Whether a region lies within a pair of parts of no more than that size together."""
    (low, high), (other_low, other_high) = (bounds[number] for number in pair)
    low, high = np.minimum(low, other_low), np.maximum(high, other_high)
    return bool((high - low).max() <= largest_px) and regions.within(region, low, high)


def _typical(displacement: DoubleArray, parts: Sequence[Numbers], used: Numbers) -> DoubleArray:
    """(P, 2) median displacement of each used part, NaN where it is too young."""
    typical = np.full((len(parts), 2), np.nan)
    for number in used.tolist():
        known = displacement[parts[number]]
        known = known[np.isfinite(known[:, 0])]
        if len(known) >= OLD_SHARE * len(parts[number]):
            typical[number] = column_medians(known)
    return typical
