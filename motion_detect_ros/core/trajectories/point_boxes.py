"""Boxes of clusters of points, fitted on the images over a baseline of a few pixels of own motion."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from motion_detect_ros.core.config import ObjectsConfig
from motion_detect_ros.core.detection.image_pair import ImagePair, image_noise
from motion_detect_ros.core.detection.photometric import (
    PhotometricTest,
    PhotometricTests,
    Place,
    photometric_tests_apart,
    reach_px,
)
from motion_detect_ros.core.geometry.boxes import Box
from motion_detect_ros.core.geometry.order_statistics import median
from motion_detect_ros.core.geometry.warp import grid_points
from motion_detect_ros.core.kernels import kernel
from motion_detect_ros.core.trajectories.clusters import Cluster
from motion_detect_ros.core.trajectories.hard_shadows import dark_side
from motion_detect_ros.core.trajectories.own_pixels import NearestPoints
from motion_detect_ros.core.trajectories.points import Points
from motion_detect_ros.core.trajectories.recent_frames import RecentFrames
from motion_detect_ros.core.trajectories.soft_shadows import SoftShadows
from motion_detect_ros.core.trajectories.strong_pixels import Outline, outlines, strong_pixels
from motion_detect_ros.core.types import BoolArray, DoubleArray, FloatArray

#: Own motion between the compared images, pixels: enough to tell object from background, little enough to look alike.
OWN_MOTION_PX = 5.0
#: Margin around a cluster that is looked at, pixels and share of its side; distance of its pixels to its points.
MARGIN_PX, MARGIN_SHARE = 6, 0.35
REACH_PX, REACH_SHARE = 9.0, 0.2
#: Points reach this far beyond their position, pixels: half a pixel and what the tracker's window sees.
POINT_REACH_PX = 1.5
#: Share of a cluster's points, and fewest, that must be as old as the baseline for their displacement to be used.
OLD_SHARE, MIN_OLD = 0.4, 3
#: Sample points of the image noise.
NOISE_ROWS, NOISE_COLUMNS = 30, 40


@dataclass(frozen=True)
class PointBox:
    """``low``, ``high``: (2,) edges of the box, working-resolution pixels; ``pixels``: in its foreground."""

    low: DoubleArray
    high: DoubleArray
    pixels: int

    @classmethod
    def around(cls, low: FloatArray, high: FloatArray) -> PointBox:
        """What points with these bounds, (2,) pixels, see, without a foreground."""
        return cls((low + 0.5 - POINT_REACH_PX).astype(np.float64), (high + 0.5 + POINT_REACH_PX).astype(np.float64), 0)


@dataclass(frozen=True)
class FittedBox:
    """``whole``: of all that moves with a cluster; ``solid``: without soft shadows; ``dark``: its ``dark_side``, if
    that is known.
    """

    whole: PointBox
    solid: PointBox
    dark: DoubleArray | None


class BoxFitter:
    """Fits boxes in one frame; clusters of the same speed are tested together, on the same pair of images."""

    def __init__(
        self, points: Points, frames: RecentFrames, mask: BoolArray | None, nearest: NearestPoints,
        shadows: SoftShadows, config: ObjectsConfig,
    ) -> None:
        self._points, self._frames, self._mask = points, frames, mask
        self._nearest, self._shadows, self._config = nearest, shadows, config

    def fit(self, clusters: Sequence[tuple[Cluster, int]]) -> list[FittedBox | None]:
        """Boxes of clusters, None where the images do not support one. With each cluster its number in ``nearest``."""
        alike: dict[int, list[int]] = {}
        for place, (cluster, _) in enumerate(clusters):
            alike.setdefault(self._frames.nearest(OWN_MOTION_PX / max(cluster.speed, 1e-3)), []).append(place)
        boxes: list[FittedBox | None] = [None] * len(clusters)
        for ago, places in alike.items():
            tests, regions = self._tests([clusters[place][0] for place in places], ago)
            for n, place in enumerate(places):
                boxes[place] = self._box(*clusters[place], tests[n], regions[n])
        return boxes

    def _tests(self, clusters: Sequence[Cluster], ago: int) -> tuple[PhotometricTests, list[Box]]:
        """Of the region around each, on the current frame and the one ``ago`` frames earlier; and the regions."""
        earlier, current = self._frames[ago], self._frames[0].gray
        height, width = current.shape
        pair = ImagePair(current, earlier.gray, earlier.matrix, self._mask)
        samples = grid_points(NOISE_ROWS, NOISE_COLUMNS, width, height)
        noise_gray = image_noise(pair, samples, np.zeros(samples.shape, np.float32))
        motions = [self._motions(cluster, ago) for cluster in clusters]
        places = [Place(_region(cluster, width, height), reach_px(motion - background), motion)
                  for cluster, (background, motion) in zip(clusters, motions, strict=True)]
        tests = photometric_tests_apart(pair, [background for background, _ in motions], places, noise_gray,
                                        self._config.photometric_sigma)
        return tests, [place.region for place in places]

    def _box(self, cluster: Cluster, number: int, test: PhotometricTest, region: Box) -> FittedBox | None:
        """test: of the region."""
        places, side_px = self._points.now[cluster.members], cluster.side_px
        self._nearest.keep_own(test.foreground, region, places, number, max(REACH_PX, REACH_SHARE * side_px))
        strong = strong_pixels(test, places, region, self._config)
        if strong is None:
            return None
        soft = self._shadows.of(strong, region, cluster.speed, side_px)
        whole, solid = outlines(strong, soft, places, region)
        box, dark = _box(whole, region), None
        if self._shadows.ground_known(cluster.speed, side_px):
            dark = dark_side(strong & ~soft, self._shadows.tones, region.left, region.top)
        return FittedBox(box, _box(solid, region) if solid else box, dark)

    def _motions(self, cluster: Cluster, ago: int) -> tuple[FloatArray, FloatArray]:
        """(2,) motion of the background and of the cluster beyond the ego-motion since ``ago``, pixels."""
        seconds, members = self._frames.seconds(ago), cluster.members
        background = cluster.background * seconds
        steps, motion = np.empty((2, len(members)), np.float32), np.empty(2, np.float32)
        old = _median_step(self._points.path, self._points.age, members, ago,
                           self._frames[ago].matrix.astype(np.float32), steps, motion)
        if old < max(MIN_OLD, OLD_SHARE * len(members)):
            motion = (background + cluster.velocity * seconds).astype(np.float32)
        return background.astype(np.float32), motion


def _box(of: Outline, region: Box) -> PointBox:
    """Around pixels of a region and what the points see."""
    (left, top, right, bottom), seen = of.bounds, PointBox.around(of.low, of.high)
    (low_x, low_y), (high_x, high_y) = seen.low.tolist(), seen.high.tolist()
    return PointBox(np.array([min(float(region.left + left), low_x), min(float(region.top + top), low_y)]),
                    np.array([max(float(region.left + right), high_x), max(float(region.top + bottom), high_y)]),
                    of.number)


def _region(cluster: Cluster, width: int, height: int) -> Box:
    (left, top), (right, bottom) = cluster.low.tolist(), cluster.high.tolist()
    return Box(math.floor(left), math.floor(top), math.ceil(right) + 1, math.ceil(bottom) + 1).grown(
        int(max(MARGIN_PX, MARGIN_SHARE * cluster.side_px)), width, height)


@kernel(error_model='numpy')
def _median_step(path, age, members, ago, matrix, steps, motion):  # type: ignore[no-untyped-def]
    """``motion``: (2,) median over the members at least ``ago`` frames old of how far they went since, beyond the
    ego-motion ``matrix``; returns their number. path: (N, frames, 2); steps: (2, n).
    """
    count = 0
    for n in range(len(members)):
        member = members[n]
        if age[member] >= ago:
            x, y = path[member, ago, 0], path[member, ago, 1]
            depth = matrix[2, 0] * x + matrix[2, 1] * y + matrix[2, 2]
            steps[0, count] = path[member, 0, 0] - (matrix[0, 0] * x + matrix[0, 1] * y + matrix[0, 2]) / depth
            steps[1, count] = path[member, 0, 1] - (matrix[1, 0] * x + matrix[1, 1] * y + matrix[1, 2]) / depth
            count += 1
    if count > 0:
        motion[0], motion[1] = median(steps[0, :count]), median(steps[1, :count])
    return count
