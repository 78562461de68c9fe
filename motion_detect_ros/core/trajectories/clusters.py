"""Clusters of neighbouring points that move alike."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from itertools import pairwise

import cv2
import numpy as np
import numpy.typing as npt

from motion_detect_ros.core.geometry.cells import near_others
from motion_detect_ros.core.geometry.order_statistics import grouped_medians
from motion_detect_ros.core.geometry.vectors import magnitude
from motion_detect_ros.core.kernels import kernel
from motion_detect_ros.core.trajectories.alike import moved_alike
from motion_detect_ros.core.trajectories.changes import changed_pixels, long_ago
from motion_detect_ros.core.trajectories.linked_groups import linked_groups
from motion_detect_ros.core.trajectories.object_motion import PointMotion
from motion_detect_ros.core.trajectories.parted_clusters import parted
from motion_detect_ros.core.trajectories.plain_bodies import MIN_PART, joined_parts
from motion_detect_ros.core.trajectories.points import THINNED_PX, Points
from motion_detect_ros.core.trajectories.recent_frames import RecentFrames
from motion_detect_ros.core.types import BoolArray, DoubleArray, FloatArray

#: Longest link between two neighbours, pixels, and how much of it must lie on what changed: a little over the spacing
#: of sparse points; and across the plain parts of a vehicle.
LINK_PX, LINK_COVERED, LONG_LINK_PX, LONG_LINK_COVERED = 20.0, 0.6, 60.0, 0.8
#: Links up to this length, pixels, are within what one point's window sees.
NEAR_PX = 6.0
#: Fewest points of a cluster, and the most moving points used, the most significant ones.
MIN_POINTS, MAX_MOVING = 5, 2500
#: Largest side of a cluster, share of the image width (144 of 960 pixels): what is larger may be vehicles in a row.
MAX_SIDE_SHARE = 0.15
#: Where short links alone hold this share of the points together, it is one, up to this size (384 of 960 pixels).
DENSE_SHARE, MAX_DENSE_SIDE_SHARE = 0.9, 0.4
#: Places along a link that are looked at, share of the way.
ALONG = np.linspace(0.1, 0.9, 9, dtype=np.float32)

Numbers = npt.NDArray[np.intp]


@dataclass(frozen=True)
class Cluster:
    """``members``: (n,) indices of points; ``low``, ``high``: (2,) bounds of their positions, pixels; ``velocity``,
    ``background``: (2,) medians of theirs, pixels/s.
    """

    members: Numbers
    low: FloatArray
    high: FloatArray
    velocity: DoubleArray
    background: DoubleArray

    @cached_property
    def side_px(self) -> float:
        """The longer side of the bounds."""
        return float((self.high - self.low).max())

    @cached_property
    def speed(self) -> float:
        """Pixels/s."""
        return float(np.hypot(*self.velocity))


def joined(clusters: Sequence[Cluster], points: Points) -> Cluster:
    """One of all of their points, which moves as the largest of them does."""
    members = np.concatenate([each.members for each in clusters])
    largest = max(clusters, key=lambda each: len(each.members))
    places = points.now[members]
    return Cluster(members, places.min(axis=0), places.max(axis=0), largest.velocity, largest.background)


def carried(clusters: Sequence[Cluster], before: Points, now: Points) -> list[tuple[Cluster, DoubleArray] | None]:
    """Clusters of the points of an earlier frame in a later one, each with the (2,) median way of its points, pixels;
    None where fewer than ``MIN_POINTS`` of them live. No point is in two clusters.
    """
    if not clusters:
        return []
    owner = np.empty(len(before), np.intp)
    members = np.concatenate([each.members for each in clusters])
    owner[members] = np.repeat(np.arange(len(clusters)), [len(each.members) for each in clusters])
    was, there = now.survivors(before, members)
    sizes = np.bincount(owner[was], minlength=len(clusters))
    stays = sizes >= MIN_POINTS
    if not stays.any():
        return [None] * len(clusters)
    kept = stays[owner[was]]
    was, there, sizes = was[kept], there[kept], sizes[stays]
    places = now.now[there]
    ways = grouped_medians(places - before.now[was], sizes)
    figures = zip(_parted(there, sizes), *_bounds(places, sizes), ways, strict=True)
    return [_carried(cluster, *next(figures)) if stay else None
            for cluster, stay in zip(clusters, stays.tolist(), strict=True)]


def _carried(
    cluster: Cluster, members: Numbers, low: FloatArray, high: FloatArray, way: DoubleArray,
) -> tuple[Cluster, DoubleArray]:
    return Cluster(members, low, high, cluster.velocity, cluster.background), way


def find_clusters(
    points: Points, motion: PointMotion, old: BoolArray, frames: RecentFrames, usual_area: float | None = None,
) -> list[Cluster]:
    """Connected components of the moving points: neighbours that move alike and have no background between them.

    Neighbours share an edge of the Delaunay triangulation with the points that stand still (``old``: (N,) points whose
    motion would be known), so no link leads over one of those; nor over pixels that look as they did before. What holds
    several objects by their ``usual_area`` is parted.
    """
    moving = np.flatnonzero(motion.moving)
    if len(moving) > MAX_MOVING:
        moving = np.sort(moving[np.argsort(-motion.sigmas[moving], kind='stable')[:MAX_MOVING]])
    if len(moving) < MIN_POINTS:
        return []
    places, still = points.now[moving], points.now[old & ~motion.moving]
    height, width = frames[0].gray.shape
    links = _links(places, still[near_others(still, places, LINK_PX, width, height)], width, height)
    links = links[moved_alike([each[moving] for each in motion.displacements], links)]
    links = links[_covered(places, links, frames)]
    groups = [moving[group] for group in linked_groups(len(moving), links, MIN_PART)]
    largest_px = MAX_SIDE_SHARE * width
    bodies = joined_parts(groups, points.now, still, motion, frames[0].half, largest_px)
    single = _parted_objects([body for body in bodies if len(body) >= MIN_POINTS], groups, points, motion, usual_area)
    found = _clusters(single, points, motion)
    return [each for each in found if each.side_px <= largest_px or (
        each.side_px <= MAX_DENSE_SIDE_SHARE * width and _dense(np.searchsorted(moving, each.members), places, links))]


def _parted_objects(
    bodies: Sequence[Numbers], groups: Sequence[Numbers], points: Points, motion: PointMotion, usual_area: float | None,
) -> list[Numbers]:
    """Members of single objects. Bodies of several ``groups`` are one by what joined them."""
    owner = np.empty(len(points), np.intp)
    for number, group in enumerate(groups):
        owner[group] = number
    return [part for body in bodies for part in (
        parted(body, points.now, motion.displacements, usual_area, MIN_POINTS) if owner[body[0]] == owner[body[-1]]
        else [body])]


def _dense(members: Numbers, places: FloatArray, links: Numbers) -> bool:
    """Whether short links alone hold ``DENSE_SHARE`` of the members together. links: (n, 2) of the places (N, 2)."""
    number = np.sort(members)
    inside = links[np.isin(links, number).all(axis=1)]
    short = inside[_lengths(places, inside) <= LINK_PX]
    groups = linked_groups(len(number), np.searchsorted(number, short))
    return max(len(group) for group in groups) >= DENSE_SHARE * len(number)


def _links(moving: FloatArray, still: FloatArray, width: int, height: int) -> Numbers:
    """(n, 2) pairs of neighbours, numbers of ``moving``, up to the longest link.

    All points are in the image, one in a cell of ``THINNED_PX`` pixels: the triangulation names them by their places.
    """
    places = np.concatenate([moving, still])
    row_by_row = np.argsort(places[:, 1] // LINK_PX * np.float32(width) + places[:, 0])  # each starts near the last one
    around = max(width, height)
    triangulation = cv2.Subdiv2D((-around, -around, 3 * around, 3 * around))
    triangulation.insert(places[row_by_row])
    edges = triangulation.getEdgeList()
    numbers = np.full((height // THINNED_PX + 1, width // THINNED_PX + 1), -1, np.int32)
    columns, rows = moving.astype(np.intp).T // THINNED_PX
    numbers[rows, columns] = np.arange(len(moving))
    pairs = np.empty((len(edges), 2), np.intp)
    return pairs[:_short_edges(edges, moving, numbers, pairs)]


@kernel()
def _short_edges(edges, moving, numbers, pairs):  # type: ignore[no-untyped-def]
    """Writes the edges between ``moving`` points as pairs of their numbers; returns how many.

    edges: (n, 4) both ends, pixels, some beyond the image; numbers: (rows, columns) those of the points in the cells,
    -1 = none.
    """
    found = 0
    for edge in range(len(edges)):
        for end in range(2):
            row, column = int(edges[edge, 2 * end + 1]) // THINNED_PX, int(edges[edge, 2 * end]) // THINNED_PX
            inside = 0 <= row < len(numbers) and 0 <= column < numbers.shape[1]
            pairs[found, end] = numbers[row, column] if inside else -1
        one, other = min(pairs[found]), max(pairs[found])
        if one >= 0 and _distance(moving, one, other) <= LONG_LINK_PX:
            pairs[found, 0], pairs[found, 1] = one, other
            found += 1
    return found


def _lengths(places: FloatArray, links: Numbers) -> FloatArray:
    return magnitude(places[links[:, 0]] - places[links[:, 1]])


def _covered(places: FloatArray, links: Numbers, frames: RecentFrames) -> BoolArray:
    """(n,) whether a link lies on what changed."""
    changed = changed_pixels(frames, long_ago(frames))
    covered = np.empty(len(links), np.bool_)
    _on_changes(places, links, changed, ALONG, covered)
    return covered


@kernel()
def _on_changes(places, links, changed, along, covered):  # type: ignore[no-untyped-def]
    """changed: (h, w), at half of the resolution of ``places``."""
    for link in range(len(links)):
        one, other = links[link]
        length = _distance(places, one, other)
        count = 0
        for way in along:
            rest = np.float32(1.0) - way
            row = int(np.rint(places[one, 1] * rest + places[other, 1] * way)) // 2
            column = int(np.rint(places[one, 0] * rest + places[other, 0] * way)) // 2
            count += changed[row, column]
        least = LONG_LINK_COVERED if length > LINK_PX else LINK_COVERED if length >= NEAR_PX else 0.0
        covered[link] = count >= least * len(along)


@kernel()
def _distance(places, one, other):  # type: ignore[no-untyped-def]
    return math.hypot(places[one, 0] - places[other, 0], places[one, 1] - places[other, 1])


def _clusters(bodies: Sequence[Numbers], points: Points, motion: PointMotion) -> list[Cluster]:
    """bodies: indices of points each."""
    if not bodies:
        return []
    members, sizes = np.concatenate(bodies), np.array([len(body) for body in bodies])
    velocity, background = (grouped_medians(each[members], sizes) for each in (motion.velocity, motion.background))
    low, high = _bounds(points.now[members], sizes)
    return [Cluster(*each) for each in zip(bodies, low, high, velocity, background, strict=True)]


def _parted(members: Numbers, sizes: Numbers) -> list[Numbers]:
    """Groups of (K,) sizes, one after the other."""
    return [members[first:end] for first, end in pairwise([0, *np.cumsum(sizes).tolist()])]


def _bounds(places: FloatArray, sizes: Numbers) -> tuple[FloatArray, FloatArray]:
    """(K, 2) lowest and highest coordinates of (K,) groups of places (N, 2), one after the other."""
    starts = np.cumsum(sizes) - sizes
    return np.minimum.reduceat(places, starts), np.maximum.reduceat(places, starts)
