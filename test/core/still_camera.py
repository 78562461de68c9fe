"""What the stages before make of the pictures of a camera that stands still."""

from __future__ import annotations

from collections.abc import Iterable

import numpy as np

from motion_detect_ros.core.trajectories.recent_frames import RecentFrames
from motion_detect_ros.core.types import EgoMotion, EgoStatus, PreparedFrame


def step(gray: np.ndarray, index: int, period_ns: int) -> tuple[PreparedFrame, EgoMotion]:
    """A picture at its full size, and the motion into it; the first one has none."""
    height, width = gray.shape
    stamp_ns, status = (index + 1) * period_ns, EgoStatus.OK if index else EgoStatus.FIRST_FRAME
    return (PreparedFrame(gray, 1.0, width, height, stamp_ns),
            EgoMotion(np.eye(3), np.eye(6), status, stamp_ns, stamp_ns - period_ns))


def frames_of(pictures: Iterable[np.ndarray], period_ns: int) -> RecentFrames:
    """The last second of them."""
    frames = RecentFrames()
    for index, gray in enumerate(pictures):
        frames.add(*step(gray, index, period_ns))
    return frames
