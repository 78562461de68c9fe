"""Boxes of clusters of points, fitted on the images over a baseline of a few pixels of own motion."""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np
import numpy.typing as npt

from motion_detect_ros.core.config import ObjectsConfig
from motion_detect_ros.core.detection.patches import connected_pixels
from motion_detect_ros.core.detection.photometric import ImagePair, image_noise, photometric_test, reach_px
from motion_detect_ros.core.geometry.boxes import Box
from motion_detect_ros.core.geometry.order_statistics import column_medians, percentile
from motion_detect_ros.core.geometry.warp import apply, grid_points
from motion_detect_ros.core.trajectories.clusters import Cluster
from motion_detect_ros.core.trajectories.points import Points
from motion_detect_ros.core.trajectories.recent_frames import RecentFrames
from motion_detect_ros.core.trajectories.soft_shadows import SoftShadows
from motion_detect_ros.core.types import BoolArray, DoubleArray, FloatArray

#: Own motion between the compared images, pixels: enough to tell object from background, little enough to look alike.
OWN_MOTION_PX = 5.0
#: Margin around a cluster that is looked at, pixels and share of its side; distance of its pixels to its points.
MARGIN_PX, MARGIN_SHARE = 6, 0.35
REACH_PX, REACH_SHARE = 9.0, 0.2
#: Points reach this far beyond their position, pixels: half a pixel and what the tracker's window sees.
POINT_REACH_PX = 1.5
#: Fewer foreground pixels than this are noise.
MIN_PIXELS = 6
#: Fewest points beside a soft shadow.
MIN_SOLID_POINTS = 3
#: Share of a cluster's points, and fewest, that must be as old as the baseline for their displacement to be used.
OLD_SHARE, MIN_OLD = 0.4, 3
#: Sample points of the image noise.
NOISE_ROWS, NOISE_COLUMNS = 30, 40
#: The gain that a patch's strongest pixels reach, as a percentile.
PEAK_PERCENTILE = 90.0


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
    """``whole``: of all that moves with a cluster; ``solid``: without soft shadows."""

    whole: PointBox
    solid: PointBox


class NearestPoints:
    """For every pixel of a region the nearest of the points in it."""

    def __init__(self, points: FloatArray, owner: npt.NDArray[np.intp]) -> None:
        """points: (N, 2) pixels; owner: (N,) what each belongs to."""
        self._places, self._owner = np.rint(points).astype(np.intp), owner

    def owners(self, region: Box) -> npt.NDArray[np.intp]:
        """(h, w) owner of the nearest point of each pixel; -1 without points."""
        columns, rows = self._places.T
        inside = ((columns >= region.left) & (columns < region.right) & (rows >= region.top) & (rows < region.bottom))
        if not inside.any():
            return np.full((region.height, region.width), -1, np.intp)
        columns, rows = columns[inside] - region.left, rows[inside] - region.top
        free = np.ones((region.height, region.width), np.uint8)
        free[rows, columns] = 0
        _, labels = cv2.distanceTransformWithLabels(
            free, cv2.DIST_L2, cv2.DIST_MASK_5, labelType=cv2.DIST_LABEL_PIXEL)
        owners = np.full(int(labels.max()) + 1, -1, np.intp)
        owners[labels[rows, columns]] = self._owner[inside]
        nearest: npt.NDArray[np.intp] = owners[labels]
        return nearest


class BoxFitter:
    """Fits boxes in one frame; image pairs are shared by clusters of the same speed."""

    def __init__(
        self, points: Points, frames: RecentFrames, mask: BoolArray | None, nearest: NearestPoints,
        shadows: SoftShadows, config: ObjectsConfig,
    ) -> None:
        self._points, self._frames, self._mask = points, frames, mask
        self._nearest, self._shadows, self._config = nearest, shadows, config
        self._pairs: dict[int, tuple[ImagePair, float]] = {}

    def fit(self, cluster: Cluster, number: int) -> FittedBox | None:
        """Box of a cluster, None where the images do not support it. number: its own in ``nearest``; -1 = still."""
        height, width = self._frames[0].gray.shape
        speed = float(np.hypot(*cluster.velocity))
        ago = self._frames.nearest(OWN_MOTION_PX / max(speed, 1e-3))
        pair, noise_gray = self._pair(ago)
        background, motion = self._motions(cluster, ago)
        region = _region(cluster, width, height)
        window = region.grown(reach_px(motion - background), width, height)
        test = photometric_test(pair, region, window, background, motion, noise_gray, self._config.photometric_sigma)
        foreground = test.foreground & self._own_pixels(cluster, number, region)
        strong = self._strong(foreground, test.gain, cluster, region)
        if np.count_nonzero(strong) < MIN_PIXELS:
            return None
        places = self._points.now[cluster.members]
        whole = _box(strong, places, region)
        shadow = self._shadows.of(strong, region, speed, cluster.side_px)
        columns, rows = np.rint(places).astype(np.intp).T
        places = places[~shadow[rows - region.top, columns - region.left]]
        solid = strong & ~shadow
        if len(places) < MIN_SOLID_POINTS or np.count_nonzero(solid) < MIN_PIXELS:
            return FittedBox(whole, whole)
        return FittedBox(whole, _box(solid, places, region))

    def _pair(self, ago: int) -> tuple[ImagePair, float]:
        """Current frame and the one ``ago``, and their image noise."""
        if ago not in self._pairs:
            earlier, current = self._frames[ago], self._frames[0].gray
            pair = ImagePair(current, earlier.gray, earlier.matrix, self._mask)
            samples = grid_points(NOISE_ROWS, NOISE_COLUMNS, current.shape[1], current.shape[0])
            self._pairs[ago] = pair, image_noise(pair, samples, np.zeros(samples.shape, np.float32))
        return self._pairs[ago]

    def _motions(self, cluster: Cluster, ago: int) -> tuple[FloatArray, FloatArray]:
        """(2,) motion of the background and of the cluster beyond the ego-motion since ``ago``, pixels."""
        seconds, members = self._frames.seconds(ago), cluster.members
        background = cluster.background * seconds
        old = members[self._points.age[members] >= ago]
        if len(old) >= max(MIN_OLD, OLD_SHARE * len(members)):
            carried = apply(self._frames[ago].matrix, self._points.path[old, ago])
            motion = column_medians(self._points.now[old] - carried)
        else:
            motion = background + cluster.velocity * seconds
        return background.astype(np.float32), motion.astype(np.float32)

    def _own_pixels(self, cluster: Cluster, number: int, region: Box) -> BoolArray:
        """(h, w) pixels of the region near the cluster's points, and nearer to them than to another cluster's."""
        far = np.ones((region.height, region.width), np.uint8)
        _mark(far, self._points.now[cluster.members], region, 0)
        distance = cv2.distanceTransform(far, cv2.DIST_L2, cv2.DIST_MASK_5)
        owners = self._nearest.owners(region)
        own: BoolArray = (distance <= max(REACH_PX, REACH_SHARE * cluster.side_px)) & (
            (owners == number) | (owners < 0))
        return own

    def _strong(self, foreground: BoolArray, gain: FloatArray, cluster: Cluster, region: Box) -> BoolArray:
        """Pixels near the peak gain of the components that touch a point of the cluster."""
        count, labels = connected_pixels(np.ascontiguousarray(foreground), self._config.closing_px)
        inside = np.zeros(foreground.shape, np.uint8)
        _mark(inside, self._points.now[cluster.members], region, 1)
        touched = np.zeros(count, np.bool_)
        touched[labels[cv2.dilate(inside, np.ones((3, 3), np.uint8)) > 0]] = True
        touched[0] = False
        component: BoolArray = foreground & touched[labels]
        if component.sum() < MIN_PIXELS:
            return component
        peak = percentile(gain[component], PEAK_PERCENTILE)
        strong: BoolArray = component & (gain > self._config.peak_share * peak)
        return strong


def _box(pixels: BoolArray, places: FloatArray, region: Box) -> PointBox:
    """Around the pixels (h, w) of a region, at least one, and what points at the places (n, 2) see."""
    rows, columns = np.nonzero(pixels)
    bounds = PointBox.around(places.min(axis=0), places.max(axis=0))
    low = np.minimum([region.left + columns.min(), region.top + rows.min()], bounds.low)
    high = np.maximum([region.left + columns.max() + 1, region.top + rows.max() + 1], bounds.high)
    return PointBox(low, high, len(rows))


def _region(cluster: Cluster, width: int, height: int) -> Box:
    margin = int(max(MARGIN_PX, MARGIN_SHARE * cluster.side_px))
    left, top = np.floor(cluster.low).astype(int).tolist()
    right, bottom = (np.ceil(cluster.high).astype(int) + 1).tolist()
    return Box(left, top, right, bottom).grown(margin, width, height)


def _mark(image: npt.NDArray[np.uint8], points: FloatArray, region: Box, value: int) -> None:
    columns, rows = np.rint(points).astype(np.intp).T
    image[rows - region.top, columns - region.left] = value
