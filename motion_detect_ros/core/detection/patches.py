"""Connected components of a foreground mask, and joining of the parts of one object."""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import lru_cache, reduce

import cv2
import numpy as np
import numpy.typing as npt

from motion_detect_ros.core.detection.several_objects import halves
from motion_detect_ros.core.geometry.boxes import Box
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


def connected_pixels(mask: BoolArray, closing_px: int) -> tuple[int, npt.NDArray[np.int32]]:
    """Connected-component labelling after morphological closing with an ellipse of ``closing_px``.

    Even sizes are rounded up: with them OpenCV shifts the mask.
    Returns the number of labels, background label 0 included, and (h, w) labels, meaningful where ``mask`` is True.
    """
    closed = cv2.morphologyEx(mask.view(np.uint8), cv2.MORPH_CLOSE, _ellipse(closing_px | 1))
    count, labels = cv2.connectedComponents(closed, connectivity=8)
    return count, labels


@lru_cache(maxsize=8)
def _ellipse(size_px: int) -> ByteArray:
    kernel: ByteArray = cv2.getStructuringElement(cv2.MORPH_ELLIPSE, (size_px, size_px))
    return kernel


def whole_body(patches: list[Patch], least_area: float, most_area: float) -> list[Patch]:
    """One patch of all, where their common box has at least and at most such areas, square pixels; else as they are."""
    if len(patches) < 2:
        return patches
    box = reduce(Box.union, (patch.box for patch in patches))
    if not least_area <= box.area <= most_area:
        return patches
    return [Patch(box, sum(patch.pixels for patch in patches))]


def joined_patches(patches: list[Patch], near_area: float = math.inf) -> list[Patch]:
    """Joins patches that are parts of one object, repeatedly.

    Two are joined where their gap is at most ``GAP_SHARE`` of the smaller one's size, and their common box is hardly
    larger than their own together: front and back of a car are, two cars side by side are not. From an area of
    ``near_area`` square pixels on, the common box may be as much larger as ``NEAR_SPREAD`` says.
    """
    done: list[Patch] = []
    waiting = list(patches)
    while waiting:
        patch = waiting.pop()
        part = next((other for other in done if _close(patch, other, near_area)), None)
        if part is None:
            done.append(patch)
        else:
            done.remove(part)
            waiting.append(Patch(patch.box.union(part.box), patch.pixels + part.pixels))
    return done


def _close(a: Patch, b: Patch, near_area: float) -> bool:
    areas = a.box.area, b.box.area
    if a.box.gap(b.box) > GAP_SHARE * math.sqrt(min(areas)):  # of most pairs
        return False
    common = a.box.union(b.box).area
    return common <= (MAX_SPREAD if common < near_area else NEAR_SPREAD) * sum(areas)


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
