"""Which points can be spared: they are many where the image changes, and most of them turn out to stand still.

Without this they fill the quota (5000 of 6000 points on most drone clips), and movers get no new points.
"""

from __future__ import annotations

import numpy as np

from motion_detect_ros.core.geometry.cells import first_of_cells, near_others
from motion_detect_ros.core.trajectories.new_points import CELL_PX, NEAR_MOVING_PX
from motion_detect_ros.core.trajectories.object_motion import PointMotion
from motion_detect_ros.core.trajectories.points import Points
from motion_detect_ros.core.trajectories.recent_frames import RecentFrames
from motion_detect_ros.core.types import BoolArray

#: A point stands still that has lived for so long, seconds, or since the first frame, with less evidence of motion than
#: this.
STANDS_S, STANDS_EVIDENCE = 0.5, 2.0


def spare_points(points: Points, motion: PointMotion, frames: RecentFrames) -> BoolArray:
    """(N,) those that stand still, far from all that moves, but for the oldest one of each cell of ``CELL_PX``.

    Near moving points they stay: they tell where an object ends. motion: of ``points``.
    """
    height, width = frames[0].gray.shape
    still: BoolArray = (points.age >= frames.nearest(STANDS_S)) & (motion.evidence < STANDS_EVIDENCE)
    places = points.now
    still[still] = ~near_others(places[still], places[motion.moving], NEAR_MOVING_PX, width, height)
    oldest_first = np.argsort(-points.age, kind='stable')
    still[first_of_cells(places, CELL_PX, width, height, oldest_first[still[oldest_first]])] = False
    return still
