"""Connected components of a foreground mask, and joining of the parts of one object."""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import lru_cache

import cv2
import numpy as np
import numpy.typing as npt

from motion_detect_ros.core.detection.several_objects import halves
from motion_detect_ros.core.geometry.boxes import Box
from motion_detect_ros.core.kernels import kernel
from motion_detect_ros.core.types import BoolArray, ByteArray

#: Largest area of the box around two parts of one object, over the sum of the areas of their own boxes.
MAX_SPREAD = 1.3
#: The same for bodies so near that they bend: limbs stick out.
NEAR_SPREAD = 2.0
#: Gap between them, at most, share of the smaller one's size.
GAP_SHARE = 0.4
#: Of a patch that may hold several objects no more than about so many pixels are looked at; each object has this share
#: of them, and so many, at least.
MOST_PLACES, LEAST_SHARE, LEAST_PLACES = 600, 0.2, 8
#: Share of each object's pixels that lie where the motion is the patch's; a piece of what passes it by has less there.
OWN_SHARE = 0.8
#: How far a pixel reaches around its centre.
HALF_PIXEL = 0.5


@dataclass(frozen=True)
class Patch:
    """Bounds and number of the pixels of a component."""

    box: Box
    pixels: int

    def moved(self, right: int, down: int) -> Patch:
        """The patch shifted by whole pixels."""
        return Patch(self.box.moved(right, down), self.pixels)


def connected_pixels(
    mask: BoolArray, closing_px: int, labels: npt.NDArray[np.int32] | None = None,
) -> tuple[int, npt.NDArray[np.int32]]:
    """Connected-component labelling after morphological closing with an ellipse of ``closing_px``.

    Even sizes are rounded up: with them OpenCV shifts the mask. labels: (h, w) to fill.
    Returns the number of labels, background label 0 included, and (h, w) labels, meaningful where ``mask`` is True.
    """
    closed = cv2.morphologyEx(mask.view(np.uint8), cv2.MORPH_CLOSE, _ellipse(closing_px | 1))
    count, labels = cv2.connectedComponents(closed, labels, connectivity=8)
    return count, labels


@lru_cache(maxsize=8)
def _ellipse(size_px: int) -> ByteArray:
    kernel: ByteArray = cv2.getStructuringElement(cv2.MORPH_ELLIPSE, (size_px, size_px))
    return kernel


def parted_patch(
    patch: Patch, foreground: BoolArray, own: BoolArray, usual_area: float, near_area: float,
) -> list[Patch]:
    """The patches of each object that a patch of the foreground, (h, w), holds: itself, or several.

    own: (h, w) where the motion is that of the patch: a half that lies elsewhere is a piece of what moves another way;
    usual_area: of ``UsualSize``; near_area: what is as large is one body.
    """
    box = patch.box
    if box.area >= near_area:
        return [patch]
    inside = slice(box.top, box.bottom), slice(box.left, box.right)
    rows, columns = np.nonzero(foreground[inside])
    sparse = slice(None, None, 1 + len(rows) // MOST_PLACES)
    rows, columns = rows[sparse], columns[sparse]
    places = np.stack([columns, rows], axis=1).astype(np.float32)
    first = halves(places, usual_area, max(LEAST_PLACES, int(LEAST_SHARE * len(places))), HALF_PIXEL)
    if first is None:
        return [patch]
    is_own = own[inside][rows, columns]
    if min(is_own[first].mean(), is_own[~first].mean()) < OWN_SHARE:
        return [patch]
    found = list[Patch]()
    for half in (first, ~first):
        (left, top), (right, bottom) = places[half].min(axis=0).astype(int), places[half].max(axis=0).astype(int) + 1
        there = Box(box.left + int(left), box.top + int(top), box.left + int(right), box.top + int(bottom))
        found += parted_patch(Patch(there, int(half.mean() * patch.pixels)), foreground, own, usual_area, near_area)
    return found


@kernel()
def join_patches(patches, starts, least_area, most_area, near_area, done, left):  # type: ignore[no-untyped-def]
    """First rows of each segment's ``patches``, (., 5) left, top, right, bottom, pixels, from ``starts`` (n + 1,) on:
    parts of one object are joined, repeatedly; ``left``: (n,) how many there are, then how many are left. done: scratch
    for the most of them.

    All are one where the area of the box around them is ``least_area`` to ``most_area``. Else two are joined where
    their gap is at most ``GAP_SHARE`` of the smaller one's size, and their common box is hardly larger than their own
    together: front and back of a car are, two cars side by side are not. From an area of ``near_area`` on, the common
    box may be as much larger as ``NEAR_SPREAD`` says.
    """
    for segment in range(len(left)):
        own, waiting, count = patches[starts[segment]:starts[segment + 1]], left[segment], 0
        if waiting < 2:
            continue
        _put(own[0], done[0])
        for n in range(1, waiting):
            _unite(done[0], own[n])
        if least_area <= (done[0, 2] - done[0, 0]) * (done[0, 3] - done[0, 1]) <= most_area:
            waiting, count = 0, 1
        while waiting > 0:
            waiting -= 1
            part = 0
            while part < count and not _close(own[waiting], done[part], near_area):
                part += 1
            if part == count:
                _put(own[waiting], done[count])
                count += 1
                continue
            _unite(own[waiting], done[part])
            waiting, count = waiting + 1, count - 1
            for n in range(part, count):
                _put(done[n + 1], done[n])
        for n in range(count):
            _put(done[n], own[n])
        left[segment] = count


@kernel()
def _put(patch, to):  # type: ignore[no-untyped-def]
    """Copies a patch, (5,)."""
    for n in range(5):  # an assignment of slices takes seconds to compile
        to[n] = patch[n]


@kernel()
def _unite(patch, other):  # type: ignore[no-untyped-def]
    """Makes a patch, (5,), one with another one."""
    for side in range(2):
        patch[side], patch[2 + side] = min(patch[side], other[side]), max(patch[2 + side], other[2 + side])
    patch[4] += other[4]


@kernel()
def _close(a, b, near_area):  # type: ignore[no-untyped-def]
    """Whether two patches, (5,), are parts of one object."""
    one, other = (a[2] - a[0]) * (a[3] - a[1]), (b[2] - b[0]) * (b[3] - b[1])
    gap = max(a[0] - b[2], b[0] - a[2], a[1] - b[3], b[1] - a[3])
    if gap > GAP_SHARE * math.sqrt(min(one, other)):  # of most pairs
        return False
    common = (max(a[2], b[2]) - min(a[0], b[0])) * (max(a[3], b[3]) - min(a[1], b[1]))
    return common <= (MAX_SPREAD if common < near_area else NEAR_SPREAD) * (one + other)
