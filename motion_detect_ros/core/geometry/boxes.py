"""Axis-aligned pixel boxes."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from motion_detect_ros.core.types import DoubleArray

#: (N, 2) low corners and (N, 2) high corners of boxes, pixels.
Edges = tuple[DoubleArray, DoubleArray]


def shared_areas(ones: Edges, others: Edges) -> DoubleArray:
    """(n, m) area, square pixels, that each of the ones shares with each of the others."""
    area: DoubleArray = _shared_sides(ones, others, 0) * _shared_sides(ones, others, 1)
    return area


def _shared_sides(ones: Edges, others: Edges, axis: int) -> DoubleArray:
    low = np.maximum(ones[0][:, axis, None], others[0][:, axis])
    sides: DoubleArray = np.minimum(ones[1][:, axis, None], others[1][:, axis])
    sides -= low
    return np.maximum(sides, 0.0, out=sides)


@dataclass(frozen=True)
class Box:
    """Left, top, right, bottom in working-resolution pixels; right and bottom are exclusive."""

    left: int
    top: int
    right: int
    bottom: int

    @property
    def edges(self) -> tuple[int, int, int, int]:
        """Left, top, right, bottom."""
        return self.left, self.top, self.right, self.bottom

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
        return (self.right - self.left) * (self.bottom - self.top)

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
