"""Clusters of neighbouring points that move alike."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
import numpy.typing as npt
from scipy.spatial import Delaunay, cKDTree

from motion_detect_ros.core.geometry.order_statistics import column_medians
from motion_detect_ros.core.geometry.vectors import magnitude
from motion_detect_ros.core.trajectories.alike import moved_alike
from motion_detect_ros.core.trajectories.changes import changed_pixels
from motion_detect_ros.core.trajectories.linked_groups import linked_groups
from motion_detect_ros.core.trajectories.object_motion import PointMotion
from motion_detect_ros.core.trajectories.plain_bodies import joined_parts
from motion_detect_ros.core.trajectories.points import Points
from motion_detect_ros.core.trajectories.recent_frames import RecentFrames
from motion_detect_ros.core.types import BoolArray, DoubleArray, FloatArray

#: Longest link between two neighbours, pixels, and how much of it must lie on what changed: a little over the spacing
#: of sparse points; and across the plain parts of a vehicle.
LINK_PX, LINK_COVERED, LONG_LINK_PX, LONG_LINK_COVERED = 20.0, 0.6, 60.0, 0.8
#: Links up to this length, pixels, are within what one point's window sees.
NEAR_PX = 6.0
#: What an object covers differs from what was there so long ago, seconds.
COVERED_S = (0.5, 1.0)
#: Points beyond every image, pixels, so that a triangulation always exists.
FAR_CORNERS = 1e5 * np.array([[-1.0, -1.1], [1.2, -1.0], [1.0, 1.3], [-1.4, 1.0]], np.float32)
#: Fewest points of a cluster, and the most moving points used, the most significant ones.
MIN_POINTS, MAX_MOVING = 5, 2500
#: Largest side of a cluster, share of the image width (144 of 960 pixels): what is larger may be vehicles in a row.
MAX_SIDE_SHARE = 0.15
#: Where short links alone hold this share of the points together, it is one, up to this size (384 of 960 pixels).
DENSE_SHARE, MAX_DENSE_SIDE_SHARE = 0.9, 0.4
#: Places along a link that are looked at, share of the way.
ALONG = np.linspace(0.1, 0.9, 9, dtype=np.float32)[:, None, None]


@dataclass(frozen=True)
class Cluster:
    """``members``: (n,) indices of points; ``low``, ``high``: (2,) bounds of their positions, pixels; ``velocity``,
    ``background``: (2,) medians of theirs, pixels/s.
    """

    members: npt.NDArray[np.intp]
    low: FloatArray
    high: FloatArray
    velocity: DoubleArray
    background: DoubleArray

    @property
    def side_px(self) -> float:
        """The longer side of the bounds."""
        return float((self.high - self.low).max())

    def at(self, members: npt.NDArray[np.intp], places: FloatArray) -> Cluster:
        """The same with other members, at least one, at the places (N, 2) of all points."""
        there = places[members]
        return replace(self, members=members, low=there.min(axis=0), high=there.max(axis=0))


def find_clusters(points: Points, motion: PointMotion, old: BoolArray, frames: RecentFrames) -> list[Cluster]:
    """Connected components of the moving points: neighbours that move alike and have no background between them.

    Neighbours share an edge of the Delaunay triangulation with the points that stand still (``old``: (N,) points whose
    motion would be known), so no link leads over one of those; nor over pixels that look as they did before.
    """
    moving = np.flatnonzero(motion.moving)
    if len(moving) > MAX_MOVING:
        moving = np.sort(moving[np.argsort(-motion.sigmas[moving], kind='stable')[:MAX_MOVING]])
    if len(moving) < MIN_POINTS:
        return []
    places, still = points.now[moving], points.now[old & ~motion.moving]
    links = _links(places, still)
    links = links[moved_alike([each[moving] for each in motion.displacements], links)]
    links = links[_covered(places, links, frames)]
    groups = [moving[group] for group in linked_groups(len(moving), links)]
    width = frames[0].gray.shape[1]
    largest_px = MAX_SIDE_SHARE * width
    bodies = joined_parts(groups, points.now, still, motion.displacements, frames[0].half, largest_px)
    found = [_cluster(body, points, motion) for body in bodies if len(body) >= MIN_POINTS]
    return [each for each in found if each.side_px <= largest_px or (
        each.side_px <= MAX_DENSE_SIDE_SHARE * width and _dense(np.searchsorted(moving, each.members), places, links))]


def _dense(members: npt.NDArray[np.intp], places: FloatArray, links: npt.NDArray[np.intp]) -> bool:
    """Whether short links alone hold ``DENSE_SHARE`` of the members together. links: (n, 2) of the places (N, 2)."""
    number = np.sort(members)
    inside = links[np.isin(links, number).all(axis=1)]
    short = inside[_lengths(places, inside) <= LINK_PX]
    groups = linked_groups(len(number), np.searchsorted(number, short))
    return max(len(group) for group in groups) >= DENSE_SHARE * len(number)


def _links(moving: FloatArray, still: FloatArray) -> npt.NDArray[np.intp]:
    """(n, 2) pairs of neighbours, numbers of ``moving``."""
    near = cKDTree(moving).query(still, distance_upper_bound=LINK_PX)[0] < LINK_PX
    first, neighbours = Delaunay(np.concatenate([moving, still[near], FAR_CORNERS])).vertex_neighbor_vertices
    one, other = np.repeat(np.arange(len(first) - 1), np.diff(first)), neighbours
    pairs = np.stack([one, other], axis=1)[(one < other) & (other < len(moving))].astype(np.intp)
    short: npt.NDArray[np.intp] = pairs[_lengths(moving, pairs) <= LONG_LINK_PX]
    return short


def _lengths(places: FloatArray, links: npt.NDArray[np.intp]) -> FloatArray:
    return magnitude(places[links[:, 0]] - places[links[:, 1]])


def _covered(places: FloatArray, links: npt.NDArray[np.intp], frames: RecentFrames) -> BoolArray:
    """(n,) whether a link lies on what changed."""
    changed = changed_pixels(frames, sorted({frames.nearest(seconds) for seconds in COVERED_S}))
    columns, rows = np.rint(places[links[:, 0]] * (1.0 - ALONG) + places[links[:, 1]] * ALONG).astype(np.intp).T // 2
    share = changed[rows, columns].mean(axis=1)
    length = _lengths(places, links)
    covered: BoolArray = np.where(length <= LINK_PX, (length < NEAR_PX) | (share >= LINK_COVERED),
                                  share >= LONG_LINK_COVERED)
    return covered


def _cluster(members: npt.NDArray[np.intp], points: Points, motion: PointMotion) -> Cluster:
    places = points.now[members]
    return Cluster(members, places.min(axis=0), places.max(axis=0), column_medians(motion.velocity[members]),
                   column_medians(motion.background[members]))
