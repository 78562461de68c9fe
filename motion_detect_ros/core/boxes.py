"""Axis-aligned pixel boxes and patches of pixels."""

from __future__ import annotations

from dataclasses import dataclass, replace

import cv2
import numpy as np

from motion_detect_ros.core.types import BoolArray, FloatArray

#: Area of the box around two parts of one body, at most, over the sum of their own boxes.
MAX_SPREAD = 1.3


@dataclass(frozen=True)
class Box:
    """Left, top, right, bottom in working-resolution pixels; right and bottom are exclusive."""

    left: int
    top: int
    right: int
    bottom: int

    @property
    def width(self) -> int:
        """Pixels."""
        return self.right - self.left

    @property
    def height(self) -> int:
        """Pixels."""
        return self.bottom - self.top

    @property
    def area(self) -> int:
        """Pixels."""
        return self.width * self.height

    def grown(self, margin: int, width: int, height: int) -> Box:
        """The box with ``margin`` on every side, cut to an image of ``width`` x ``height``."""
        return Box(max(0, self.left - margin), max(0, self.top - margin),
                   min(width, self.right + margin), min(height, self.bottom + margin))

    def moved(self, right: int, down: int) -> Box:
        """The box shifted by whole pixels."""
        return Box(self.left + right, self.top + down, self.right + right, self.bottom + down)

    def union(self, other: Box) -> Box:
        """The smallest box around both."""
        return Box(min(self.left, other.left), min(self.top, other.top),
                   max(self.right, other.right), max(self.bottom, other.bottom))

    def gap(self, other: Box) -> int:
        """Largest distance along an axis between the boxes; 0 where they touch or overlap."""
        return max(0, self.left - other.right, other.left - self.right,
                   self.top - other.bottom, other.top - self.bottom)

    def points(self) -> FloatArray:
        """(height, width, 2) float32: the (x, y) of every pixel."""
        y, x = np.mgrid[self.top:self.bottom, self.left:self.right].astype(np.float32)
        return np.stack([x, y], axis=-1)


@dataclass(frozen=True)
class Patch:
    """Pixels that belong together: their bounds, and their number."""

    box: Box
    pixels: int

    @property
    def fill(self) -> float:
        """Share of the bounds that the pixels cover."""
        return self.pixels / self.box.area

    def moved(self, right: int, down: int) -> Patch:
        """The patch shifted by whole pixels."""
        return replace(self, box=self.box.moved(right, down))


def connected_patches(mask: BoolArray, closing_px: int) -> list[BoolArray]:
    """One (h, w) mask for each group of pixels that hang together once gaps up to ``closing_px`` are closed."""
    kernel = cv2.getStructuringElement(cv2.MORPH_ELLIPSE, (closing_px, closing_px))
    closed = cv2.morphologyEx(mask.astype(np.uint8), cv2.MORPH_CLOSE, kernel)
    count, labels = cv2.connectedComponents(closed, connectivity=8)
    labels[~mask] = 0
    return [labels == number for number in range(1, count)]


def bounding_patch(mask: BoolArray) -> Patch:
    """Bounds and number of the true pixels of a (h, w) mask that has at least one."""
    ys, xs = np.nonzero(mask)
    box = Box(int(xs.min()), int(ys.min()), int(xs.max()) + 1, int(ys.max()) + 1)
    return Patch(box, len(xs))


def joined_patches(patches: list[Patch], gap_share: float) -> list[Patch]:
    """Joins patches that are parts of one body, until none are.

    They are closer than ``gap_share`` of the smaller one's size, and together fill their box as they fill their own:
    the front and the back of a car do, two cars side by side do not.
    """
    done: list[Patch] = []
    waiting = list(patches)
    while waiting:
        patch = waiting.pop()
        near = next((other for other in done if _close(patch, other, gap_share)), None)
        if near is None:
            done.append(patch)
        else:
            done.remove(near)
            waiting.append(Patch(patch.box.union(near.box), patch.pixels + near.pixels))
    return done


def _close(a: Patch, b: Patch, gap_share: float) -> bool:
    size_px = float(np.sqrt(min(a.box.area, b.box.area)))
    packed = a.box.union(b.box).area <= MAX_SPREAD * (a.box.area + b.box.area)
    return packed and a.box.gap(b.box) <= gap_share * size_px
