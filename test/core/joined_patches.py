"""Patches as the kernel that joins them takes them."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np

from motion_detect_ros.core.detection.patches import Patch, join_patches
from motion_detect_ros.core.geometry.boxes import Box


def joined_patches(
    patches: Sequence[Patch], near_area: float = math.inf, least_area: float = math.inf, most_area: float = math.inf,
) -> list[Patch]:
    """What is left of them."""
    rows = np.array([(*each.box.edges, each.pixels) for each in patches], np.int64).reshape(-1, 5)
    left = np.array([len(rows)])
    join_patches(rows, np.array([0, len(rows)]), least_area, most_area, near_area, np.empty_like(rows), left)
    return [Patch(Box(*row[:4]), row[4]) for row in rows[:left[0]].tolist()]
