"""Clusters of neighbouring points that move alike."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components
from scipy.spatial import Delaunay, cKDTree

from motion_detect_ros.core.trajectories.object_motion import PointMotion
from motion_detect_ros.core.trajectories.points import Points
from motion_detect_ros.core.types import BoolArray, DoubleArray, FloatArray

#: Longest link between two neighbours, pixels: a little over the spacing of sparse points; they move alike up to this
#: difference of velocity, pixels/s and share of the slower one's.
LINK_PX, LINK_PX_S, LINK_SHARE = 20.0, 2.0, 0.15
#: Points beyond every image, pixels, so that a triangulation always exists.
FAR_CORNERS = 1e5 * np.array([[-1.0, -1.1], [1.2, -1.0], [1.0, 1.3], [-1.4, 1.0]], np.float32)
#: Fewest points of a cluster, and the most moving points used, the most significant ones.
MIN_POINTS, MAX_MOVING = 3, 2500
#: Largest side of a cluster, share of the image width (80 of 960 pixels): dense flow sees what is larger.
MAX_SIDE_SHARE = 1.0 / 12.0


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


def find_clusters(points: Points, motion: PointMotion, old: BoolArray, width: int) -> list[Cluster]:
    """Connected components of the moving points: neighbours that move alike are linked.

    Neighbours share an edge of the Delaunay triangulation with the points that stand still (``old``: (N,) points whose
    motion would be known), so no link leads over one of those: the road between two cars keeps them apart.
    """
    moving = np.flatnonzero(motion.moving)
    if len(moving) > MAX_MOVING:
        moving = np.sort(moving[np.argsort(-motion.sigmas[moving], kind='stable')[:MAX_MOVING]])
    if len(moving) < MIN_POINTS:
        return []
    links = _links(points.now, moving, np.flatnonzero(old & ~motion.moving))
    links = links[_alike(motion.velocity[moving], links)]
    graph = coo_array((np.ones(len(links)), (links[:, 0], links[:, 1])), shape=(len(moving), len(moving)))
    count, labels = connected_components(graph, directed=False)
    order = np.argsort(labels, kind='stable')
    groups = np.split(moving[order], np.cumsum(np.bincount(labels, minlength=count))[:-1])
    found = [_cluster(group, points, motion) for group in groups if len(group) >= MIN_POINTS]
    return [each for each in found if each.side_px <= MAX_SIDE_SHARE * width]


def _links(
    places: FloatArray, moving: npt.NDArray[np.intp], still: npt.NDArray[np.intp],
) -> npt.NDArray[np.intp]:
    """(n, 2) pairs of neighbours as numbers within ``moving``."""
    near = cKDTree(places[moving]).query(places[still], distance_upper_bound=LINK_PX)[0] < LINK_PX
    triangles = Delaunay(np.concatenate([places[moving], places[still[near]], FAR_CORNERS])).simplices
    pairs = np.unique(np.sort(triangles[:, [[0, 1], [1, 2], [2, 0]]].reshape(-1, 2), axis=1), axis=0)
    pairs = pairs[pairs[:, 1] < len(moving)].astype(np.intp)
    way = places[moving[pairs[:, 0]]] - places[moving[pairs[:, 1]]]
    short: npt.NDArray[np.intp] = pairs[np.hypot(way[:, 0], way[:, 1]) <= LINK_PX]
    return short


def _alike(velocity: DoubleArray, links: npt.NDArray[np.intp]) -> BoolArray:
    one, other = velocity[links[:, 0]], velocity[links[:, 1]]
    difference = one - other
    speed = np.minimum(np.hypot(one[:, 0], one[:, 1]), np.hypot(other[:, 0], other[:, 1]))
    alike: BoolArray = np.hypot(difference[:, 0], difference[:, 1]) < LINK_PX_S + LINK_SHARE * speed
    return alike


def _cluster(members: npt.NDArray[np.intp], points: Points, motion: PointMotion) -> Cluster:
    places = points.now[members]
    return Cluster(members, places.min(axis=0), places.max(axis=0), np.median(motion.velocity[members], axis=0),
                   np.median(motion.background[members], axis=0))
