"""Objects from clusters of points: boxes that are fitted and believed, and where they go from frame to frame."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import partial

import numpy as np
import numpy.typing as npt

from motion_detect_ros.core.config import ObjectsConfig
from motion_detect_ros.core.detection.candidate import Candidate
from motion_detect_ros.core.detection.objects import is_allowed
from motion_detect_ros.core.trajectories.changed_regions import ChangedRegions
from motion_detect_ros.core.trajectories.clusters import MIN_POINTS, Cluster, carried, joined
from motion_detect_ros.core.trajectories.own_pixels import NearestPoints
from motion_detect_ros.core.trajectories.parted_clusters import parted
from motion_detect_ros.core.trajectories.point_boxes import BoxFitter, PointBox
from motion_detect_ros.core.trajectories.point_counts import PointCounts
from motion_detect_ros.core.trajectories.point_scoring import ClusterFigures, PointScore
from motion_detect_ros.core.trajectories.points import Points
from motion_detect_ros.core.trajectories.recent_frames import RecentFrames
from motion_detect_ros.core.trajectories.soft_shadows import SoftShadows
from motion_detect_ros.core.types import BoolArray, DoubleArray

#: With so much lower log odds than the least, taken with the bounds of the points, no box is fitted.
UNFITTED_LOG_ODDS = 0.5
#: How far around a box the points are looked at, pixels.
AROUND_PX = 10.0
#: Points reach beyond an object by a good part of its size where this is under so many pixels, the square root of its
#: box; a region of change from this intersection over union with its box on shows the same object.
SMALL_PX, SAME_IOU = 32.0, 0.2
#: ``Candidate.cluster`` of what no ART2 neuron won.
NO_NEURON = 0


@dataclass(frozen=True)
class ClusteredPoints:
    """Clusters of one frame. ``points``: of it; ``known``, ``moving``: which of these are old enough to show
    motion, and do; ``displacements``, ``usual_area``: as ``parted_clusters.parted`` takes them.
    """

    clusters: list[Cluster]
    points: Points
    known: npt.NDArray[np.intp]
    moving: npt.NDArray[np.intp]
    displacements: Sequence[DoubleArray] = ()
    usual_area: float | None = None

    def is_one(self, cluster: Cluster) -> bool:
        """Whether a cluster of several of these is a single object."""
        return len(parted(cluster.members, self.points.now, self.displacements, self.usual_area, MIN_POINTS)) == 1


@dataclass(frozen=True)
class FoundObject:
    """Box in working-resolution pixels; the figures and the log odds are those of the frame it was found in."""

    cluster: Cluster
    box: PointBox
    figures: ClusterFigures
    log_odds: float
    dark: DoubleArray | None

    def moved(self, cluster: Cluster, way: DoubleArray) -> FoundObject:
        """With its cluster in a later frame, its box shifted; way: (2,) pixels."""
        box = PointBox(self.box.low + way, self.box.high + way, self.box.pixels)
        return FoundObject(cluster, box, self.figures, self.log_odds, self.dark)

    def candidate(self, scale: float) -> Candidate:
        """scale: working pixels per full-resolution pixel."""
        low, high = self.box.low / scale, self.box.high / scale
        return Candidate((low + high) / 2.0, high - low, self.cluster.velocity / scale, self.box.pixels / scale ** 2,
                         self.log_odds, NO_NEURON)


def moved_on(objects: Sequence[FoundObject], before: Points, now: Points) -> list[FoundObject]:
    """Where the points that live on have gone, without those of which too few do."""
    there = carried([each.cluster for each in objects], before, now)
    return [each.moved(*to) for each, to in zip(objects, there, strict=True) if to]


def objects_of(
    of: ClusteredPoints, frames: RecentFrames, mask: BoolArray | None, shadows: SoftShadows, config: ObjectsConfig,
    score: PointScore,
) -> list[FoundObject]:
    """Clusters of the current one of ``frames`` that have a box and are believed.

    mask: (h, w), False = not the scene; None = nowhere.
    """
    clusters, places, shape = of.clusters, of.points.now, frames[0].gray.shape
    if not clusters:
        return []
    known, moving = PointCounts(places[of.known], shape), PointCounts(places[of.moving], shape)
    owner = np.full(len(places), -1, np.intp)
    for number, cluster in enumerate(clusters):
        owner[cluster.members] = number
    fitter = BoxFitter(of.points, frames, mask, NearestPoints(places[of.known], owner[of.known]), shadows, config)
    bounds = _figures(clusters, [PointBox.around(cluster.low, cluster.high) for cluster in clusters], known, moving)
    hopeful = [(cluster, number) for number, cluster in enumerate(clusters)
               if score.log_odds(bounds[number]) >= score.least - UNFITTED_LOG_ODDS]
    allowed = partial(_is_allowed, image_area=shape[0] * shape[1], config=config)
    found = [(cluster, box) for (cluster, _), box in zip(hopeful, fitter.fit(hopeful), strict=True)
             if box is not None and allowed(box.whole)]
    if not found:
        return []
    there, boxes = zip(*found, strict=True)
    figures = _figures(there, [box.whole for box in boxes], known, moving)
    objects = [FoundObject(cluster, box.solid, one, score.log_odds(one), box.dark)
               for (cluster, box), one in zip(found, figures, strict=True)]
    believed = [each for each in objects if each.log_odds >= score.least]
    if not believed:
        return []
    regions = ChangedRegions.of(frames, mask)
    sharp = _sharpened(believed, regions)
    bodies = [(body, parts) for body, parts in _bodies(sharp, regions, of.points, known, moving, score)
              if body.log_odds >= score.least and allowed(body.box) and of.is_one(body.cluster)]
    gone = {part for _, parts in bodies for part in parts}
    return [each for number, each in enumerate(sharp) if number not in gone] + [body for body, _ in bodies]


def _is_allowed(box: PointBox, image_area: int, config: ObjectsConfig) -> bool:
    return is_allowed((box.high - box.low).tolist(), image_area, config)


def _sharpened(objects: Sequence[FoundObject], regions: ChangedRegions) -> list[FoundObject]:
    """The boxes of small ones averaged with those of the regions of change most like them."""
    low, high = _edges(objects)
    best, iou = regions.most_alike(low, high)
    small = (high - low).prod(axis=1) < SMALL_PX ** 2
    return [replace(each, box=_averaged(each.box, each.cluster, regions, region)) if sharpens else each
            for each, region, sharpens in zip(objects, best.tolist(), small & (iou >= SAME_IOU), strict=True)]


def _averaged(box: PointBox, cluster: Cluster, regions: ChangedRegions, region: int) -> PointBox:
    low, high = regions.without_tail(region, box.low, box.high, cluster.velocity)
    return PointBox((box.low + low) / 2.0, (box.high + high) / 2.0, box.pixels)


def _bodies(
    objects: Sequence[FoundObject], regions: ChangedRegions, points: Points, known: PointCounts, moving: PointCounts,
    score: PointScore,
) -> list[tuple[FoundObject, list[int]]]:
    """Objects as which several of these may be one, and the numbers of these: parts of a large vehicle moved
    differently.
    """
    bodies = regions.bodies(*_edges(objects))
    if not bodies:
        return []
    clusters = [joined([objects[part].cluster for part in parts], points) for _, parts in bodies]
    boxes = [_averaged(_around([objects[part].box for part in parts]), cluster, regions, region)
             for cluster, (region, parts) in zip(clusters, bodies, strict=True)]
    figures = _figures(clusters, boxes, known, moving)
    return [(FoundObject(cluster, box, one, score.log_odds(one), None), parts.tolist())
            for cluster, box, one, (_, parts) in zip(clusters, boxes, figures, bodies, strict=True)]


def _edges(objects: Sequence[FoundObject]) -> tuple[DoubleArray, DoubleArray]:
    return np.array([each.box.low for each in objects]), np.array([each.box.high for each in objects])


def _around(boxes: Sequence[PointBox]) -> PointBox:
    return PointBox(np.min([each.low for each in boxes], axis=0), np.max([each.high for each in boxes], axis=0),
                    sum(each.pixels for each in boxes))


def _figures(
    clusters: Sequence[Cluster], boxes: Sequence[PointBox], known: PointCounts, moving: PointCounts,
) -> list[ClusterFigures]:
    low, high = np.array([box.low for box in boxes]), np.array([box.high for box in boxes])
    inside, moving_inside = known.within(low, high, 0.0), moving.within(low, high, 0.0)
    around = known.within(low, high, AROUND_PX) - inside
    moving_around = moving.within(low, high, AROUND_PX) - moving_inside
    return [ClusterFigures(len(cluster.members), *shares) for cluster, *shares in zip(
        clusters, (moving_inside / np.maximum(1, inside)).tolist(), (moving_around / np.maximum(1, around)).tolist(),
        strict=True)]
