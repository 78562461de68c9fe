"""Long-lived points, tracked from frame to frame at working resolution (Lucas and Kanade 1981; Bouguet 2001).

A point starts from the ego-motion and its own velocity, so no pyramid is needed, and what is a few pixels large keeps
its own motion. Points that fail, as those on fast objects do while their velocity is not known, are tracked again over
a pyramid. About every 0.07 s points are tracked back as well (Kalal et al. 2010), every second one in the frame after,
so that frames take equally long. Lengths are pixels of the working resolution and do not scale with it: they belong to
the tracker's window.
"""

from __future__ import annotations

from dataclasses import dataclass, field

import cv2
import numpy as np
import numpy.typing as npt

from motion_detect_ros.core.geometry.cells import first_of_cells
from motion_detect_ros.core.geometry.lucas_kanade import by_parts
from motion_detect_ros.core.geometry.vectors import magnitude
from motion_detect_ros.core.geometry.warp import apply, points_at_scale
from motion_detect_ros.core.kernels import kernel
from motion_detect_ros.core.periods import Every
from motion_detect_ros.core.preprocessing.scene_mask import InnerScene
from motion_detect_ros.core.trajectories.new_points import BORDER_PX, NewPoints
from motion_detect_ros.core.trajectories.recent_frames import MAX_FRAMES, RecentFrame, RecentFrames
from motion_detect_ros.core.types import BoolArray, ByteArray, FloatArray

#: Window of the tracker, width and height, pixels: OpenCV handles 8 pixels of a row at once, others one by one. Its
#: iterations and the step, pixels, at which they end; least eigenvalue of its matrix, and largest mean error, grey
#: levels.
WINDOW_PX = 8, 10
#: Least distance of points from what the mask leaves out, pixels: their windows must not see text or hull, which stand
#: still and would seem to move against the ground.
MASKED_PX = 6
ITERATIONS, SMALL_STEP_PX = 12, 0.02
LEAST_EIGENVALUE, MAX_ERROR_GRAY = 6e-4, 18.0
#: Levels of the pyramid, above the first, for points that are not where they were looked for, and the window there; the
#: first of them is the halved image.
FAR_LEVELS, FAR_WINDOW_PX = 2, (8, 8)
#: How often points are tracked back, too, and new ones start, seconds; largest forward-backward error, pixels.
CHECKED_EVERY_S, FORWARD_BACKWARD_PX = 0.07, 0.3
#: A point is looked for from as far off on its way back as on its way there, but no farther than this, pixels, from
#: which it is found without a pyramid.
REACH_PX = 3.0
#: Of points in one cell of this size the oldest stays, pixels.
THINNED_PX = 2
#: No mask.
EVERYWHERE: BoolArray = np.empty((0, 0), np.bool_)
#: Weight of a new velocity against the remembered one.
VELOCITY_GAIN = 0.5
#: New points start with the mean velocity of those in their cell of this size, pixels.
NEIGHBOURHOOD_PX = 24
#: Cells are numbered row by row for images up to this width, pixels.
MAX_WIDTH_PX = 8192

_OPTIONS = {
    'flags': cv2.OPTFLOW_USE_INITIAL_FLOW, 'minEigThreshold': LEAST_EIGENVALUE,
    'criteria': (cv2.TERM_CRITERIA_COUNT + cv2.TERM_CRITERIA_EPS, ITERATIONS, SMALL_STEP_PX)}


def _no_points() -> FloatArray:
    return np.zeros((0, MAX_FRAMES, 2), np.float32)


@dataclass(frozen=True)
class Points:
    """``path``: (N, MAX_FRAMES, 2) positions in the ``RecentFrames``, pixels, current one first, NaN before a point's
    start; ``age``: (N,) how many of these ago it started, at most MAX_FRAMES - 1; ``velocity``: (N, 2) beyond the
    ego-motion, pixels/s; ``number``: (N,) ascending, that of a point for as long as it lives.
    """

    path: FloatArray = field(default_factory=_no_points)
    age: npt.NDArray[np.int32] = field(default_factory=lambda: np.zeros(0, np.int32))
    velocity: FloatArray = field(default_factory=lambda: np.zeros((0, 2), np.float32))
    number: npt.NDArray[np.int64] = field(default_factory=lambda: np.zeros(0, np.int64))

    def __len__(self) -> int:
        return len(self.age)

    @property
    def now(self) -> FloatArray:
        """(N, 2) current positions."""
        return self.path[:, 0]

    def only(self, chosen: npt.NDArray[np.intp]) -> Points:
        """The chosen ones."""
        return Points(self.path[chosen], self.age[chosen], self.velocity[chosen], self.number[chosen])

    def moved(
        self, chosen: npt.NDArray[np.intp], now: FloatArray, velocity: FloatArray, made_room: int | None = None,
    ) -> Points:
        """The chosen ones a frame later, at ``now`` with ``velocity``, (N, 2) of all.

        made_room: number of an earlier frame, counted from that one, that is no longer kept; None = all are.
        """
        last = MAX_FRAMES if made_room is None else made_room
        path = np.empty((len(chosen), *self.path.shape[1:]), np.float32)
        path[:, 0], path[:, 1:last] = now[chosen], self.path[chosen, :last - 1]
        path[:, last:] = self.path[chosen, last:]
        age = self.age[chosen]
        age = np.minimum(age + (age + 1 < last), MAX_FRAMES - 1).astype(np.int32)
        return Points(path, age, velocity[chosen], self.number[chosen])

    def started(self, places: FloatArray, first_number: int) -> Points:
        """With new ones at ``places``, (n, 2), numbered from ``first_number`` on."""
        path = np.full((len(places), MAX_FRAMES, 2), np.nan, np.float32)
        path[:, 0] = places
        return Points(np.concatenate([self.path, path]), np.r_[self.age, np.zeros(len(places), np.int32)],
                      np.concatenate([self.velocity, self._velocities_near(places)]),
                      np.r_[self.number, first_number + np.arange(len(places), dtype=np.int64)])

    def survivors(
        self, before: Points, chosen: npt.NDArray[np.intp],
    ) -> tuple[npt.NDArray[np.intp], npt.NDArray[np.intp]]:
        """Which of the chosen points of an earlier frame still live: their indices then, and now."""
        if not len(self):
            return chosen[:0], chosen[:0]
        places = np.minimum(np.searchsorted(self.number, before.number[chosen]), len(self) - 1)
        alive = self.number[places] == before.number[chosen]
        return chosen[alive], places[alive]

    def _velocities_near(self, places: FloatArray) -> FloatArray:
        """(n, 2) mean velocity of the points in the same cell, 0 where there are none."""
        own, new = _cells(self.now, NEIGHBOURHOOD_PX), _cells(places, NEIGHBOURHOOD_PX)
        size = 1 + int(max(own.max(initial=0), new.max(initial=0)))
        count = np.maximum(1, np.bincount(own, minlength=size))
        return np.stack([(np.bincount(own, self.velocity[:, axis], size) / count)[new] for axis in (0, 1)],
                        axis=1).astype(np.float32)


class PointTracker:
    """Tracks points through the frames of a ``RecentFrames`` and starts new ones.

    ``new_due``: whether new ones are to start in the current frame.
    """

    def __init__(self, max_points: int) -> None:
        self._new, self._every = NewPoints(max_points), Every(CHECKED_EVERY_S)
        self._scene = InnerScene(MASKED_PX)
        self.reset()

    def reset(self) -> None:
        """Clear all points."""
        self._new.reset()
        self._every.reset()
        self._points, self._started = Points(), 0
        self._moving = self._points.number
        self.new_due = self._half_due = False

    def track(self, frames: RecentFrames, mask: BoolArray | None) -> Points:
        """Those of the last frame that are found in the current one.

        mask: (h, w), False where the picture does not show the scene, within ``MASKED_PX`` of which no point may be;
        None = it does everywhere. With one frame in ``frames`` all earlier points are cleared.
        """
        if len(frames) < 2:
            self._points = Points()
            self._every.reset()
        other_half, self.new_due = self._half_due, self._every.due(frames.seconds(min(1, len(frames) - 1)))
        self._half_due = self.new_due
        if len(self._points):
            odd = self._points.number % 2 == 1
            checked = odd if other_half else ~odd if self.new_due else np.zeros(len(odd), np.bool_)
            self._points = self._tracked(frames, self._scene.of(mask), checked)
        return self._points

    def start(self, frames: RecentFrames, mask: BoolArray | None) -> Points:
        """Those of the current frame with new ones, where these are due; after ``track`` with the same arguments."""
        if self.new_due:
            self.new_due = False
            self._every.done()
            moving = self._points.now[np.isin(self._points.number, self._moving)]
            places = self._new.places(self._points.now, frames, self._scene.of(mask), moving)
            self._points = self._points.started(places, self._started)
            self._started += len(places)
        return self._points

    def told(self, moving: BoolArray, spare: BoolArray) -> None:
        """Of the points of the last ``start``: new ones start near ``moving`` first, ``spare`` go; (N,) masks."""
        self._moving = self._points.number[moving]
        self._points = self._points.only(np.flatnonzero(~spare))

    def _tracked(self, frames: RecentFrames, mask: BoolArray | None, checked: BoolArray) -> Points:
        """checked: (N,) which points are tracked back, too."""
        points, dt_s = self._points, frames.seconds(1)
        current, previous = frames[0], frames[1]
        carried = apply(frames[1].matrix, points.now)
        start = carried + points.velocity * np.float32(dt_s)
        now, good = by_parts(
            lambda part: _followed(previous, current, points.now[part], start[part], checked[part]), len(points))
        good &= _usable(now, current.gray.shape, mask)
        velocity = (now - carried) / np.float32(dt_s)
        gain = np.where(points.age > 0, VELOCITY_GAIN, 1.0).astype(np.float32)[:, None]
        oldest_first = np.argsort(-points.age, kind='stable')
        height, width = current.gray.shape
        one_a_cell = first_of_cells(now, THINNED_PX, width, height, oldest_first[good[oldest_first]])
        return points.moved(one_a_cell, now, points.velocity + gain * (velocity - points.velocity), frames.made_room)


def _at_most(vectors: FloatArray, length_px: float) -> FloatArray:
    """(N, 2) vectors, those that are longer shortened to this length."""
    share = length_px / np.maximum(magnitude(vectors), length_px)
    return (vectors * share[:, None]).astype(np.float32)


def _followed(
    one: RecentFrame, other: RecentFrame, points: FloatArray, start: FloatArray, checked: BoolArray,
) -> tuple[FloatArray, BoolArray]:
    """As ``_follow``; ``checked`` ones, (N,), are found where the way back ends where they were, too."""
    now, good = _follow(one, other, points, start)
    back_too = np.flatnonzero(checked)
    if len(back_too):
        was, there = points[back_too], now[back_too]
        off = _at_most(there - start[back_too], REACH_PX)
        back, found = _lucas_kanade(other.gray, one.gray, there, was + off)
        good[back_too] &= found & (magnitude(back - was) < FORWARD_BACKWARD_PX)
    return now, good


def _follow(
    one: RecentFrame, other: RecentFrame, points: FloatArray, start: FloatArray,
) -> tuple[FloatArray, BoolArray]:
    """(N, 2) positions in ``other``, and (N,) whether they were found, over a pyramid where not without."""
    now, good = _lucas_kanade(one.gray, other.gray, points, start)
    failed = np.flatnonzero(~good)
    if len(failed):
        far, _ = _lucas_kanade(one.half, other.half, points_at_scale(points[failed], 0.5),
                               points_at_scale(start[failed], 0.5), FAR_WINDOW_PX, FAR_LEVELS - 1)
        now[failed], good[failed] = _lucas_kanade(one.gray, other.gray, points[failed], points_at_scale(far, 2.0))
    return now, good


def _lucas_kanade(
    one: ByteArray, other: ByteArray, points: FloatArray, start: FloatArray, window_px: tuple[int, int] = WINDOW_PX,
    levels: int = 0,
) -> tuple[FloatArray, BoolArray]:
    """(N, 2) positions in ``other``, and (N,) whether they were found.

    window_px: width and height; levels: of the pyramid, above the first.
    """
    moved, found, error = cv2.calcOpticalFlowPyrLK(
        one, other, np.ascontiguousarray(points), np.array(start, np.float32, order='C'),
        **{**_OPTIONS, 'winSize': window_px, 'maxLevel': levels})
    good: BoolArray = (found.ravel() > 0) & (error.ravel() < MAX_ERROR_GRAY)
    return moved, good


def _usable(places: FloatArray, shape: tuple[int, ...], mask: BoolArray | None) -> BoolArray:
    """(N,) whether a place is on the image, away from its border, and in the mask."""
    usable = np.empty(len(places), np.bool_)
    _fill_usable(places, *shape, EVERYWHERE if mask is None else mask, usable)
    return usable


@kernel()
def _fill_usable(places, height, width, mask, usable):  # type: ignore[no-untyped-def]
    """mask: (height, width), or empty, which is True everywhere; places: (N, 2), NaN = nowhere."""
    for n in range(len(places)):
        x, y = places[n, 0], places[n, 1]
        inside = BORDER_PX <= x < width - BORDER_PX and BORDER_PX <= y < height - BORDER_PX
        usable[n] = inside and (mask.size == 0 or mask[int(np.rint(y)), int(np.rint(x))])


def _cells(places: FloatArray, size_px: int) -> npt.NDArray[np.int64]:
    """(N,) number of the square cell of each place."""
    column, row = (places // size_px).astype(np.int64).T
    return row * (MAX_WIDTH_PX // size_px) + column
