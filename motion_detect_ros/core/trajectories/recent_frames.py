"""The frames of about the last second, each with its warp to the current one, at working resolution."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import cv2
import numpy as np

from motion_detect_ros.core.geometry.warp import at_scale, stabilise
from motion_detect_ros.core.trajectories.light import relit, shrunk
from motion_detect_ros.core.types import NANOSECONDS, ByteArray, DoubleArray, EgoMotion, PreparedFrame

#: How long frames are kept, seconds, and how many at most, the current one included: all of 30 a second.
KEPT_S, MAX_FRAMES = 1.02, 32


@dataclass(frozen=True)
class RecentFrame:
    """``gray``: (h, w) uint8; ``half``: at half the size; ``matrix``: (3, 3) its pixel -> current pixel, working
    resolution; ``stamp_ns``.
    """

    gray: ByteArray
    half: ByteArray
    matrix: DoubleArray
    stamp_ns: int

    @cached_property
    def shrunk(self) -> ByteArray:
        """``half`` shrunk for the light: the current frame is compared with several."""
        return shrunk(self.half)


class RecentFrames:
    """Current frame first, then the one before it. Emptied where the ego-motion between two of them is missing.

    Of more than ``MAX_FRAMES`` one makes room for the current one, so that at any frame rate the others reach back over
    ``KEPT_S``. ``made_room``: what its number would be now, None = none has.
    """

    def __init__(self) -> None:
        self._frames: list[RecentFrame] = []
        self._earlier = dict[int, ByteArray]()
        self.made_room: int | None = None

    def __len__(self) -> int:
        return len(self._frames)

    def __getitem__(self, frames_ago: int) -> RecentFrame:
        return self._frames[frames_ago]

    def copy(self) -> RecentFrames:
        """The same frames, which stay as they are when others are added here."""
        frames = RecentFrames()
        frames._frames, frames._earlier = self._frames, self._earlier
        return frames

    def reset(self) -> None:
        """Clear all frames."""
        self._frames, self._earlier = [], {}

    def add(self, frame: PreparedFrame, ego: EgoMotion) -> bool:
        """Add a frame; False where it does not continue the ones before, which are cleared then."""
        newest = self._frames[0] if self._frames else None
        follows = (newest is not None and ego.ok and ego.prev_stamp_ns == newest.stamp_ns
                   and newest.gray.shape == frame.gray.shape)
        if not follows:
            self.reset()
        step = at_scale(ego.matrix, frame.scale)
        oldest_ns = frame.stamp_ns - round(KEPT_S * NANOSECONDS)
        kept = [each for each in self._frames if each.stamp_ns >= oldest_ns]
        self._earlier = {}
        self._frames = [RecentFrame(frame.gray, _halved(frame.gray), np.eye(3), frame.stamp_ns),
                        *(RecentFrame(each.gray, each.half, step @ each.matrix, each.stamp_ns) for each in kept)]
        self.made_room = _least_missed(self._frames) if len(self._frames) > MAX_FRAMES else None
        if self.made_room is not None:
            del self._frames[self.made_room]
        return follows

    def earlier_half(self, frames_ago: int) -> ByteArray:
        """(ceil(h / 2), ceil(w / 2)) an earlier frame, halved, in the place and the light of the current one."""
        if frames_ago not in self._earlier:
            earlier, current = self._frames[frames_ago], self._frames[0]
            self._earlier[frames_ago] = relit(stabilise(earlier.half, at_scale(earlier.matrix, 0.5)), current.shrunk)
        return self._earlier[frames_ago]

    def seconds(self, frames_ago: int) -> float:
        """Time from that frame to the current one."""
        return (self._frames[0].stamp_ns - self._frames[frames_ago].stamp_ns) / NANOSECONDS

    def nearest(self, seconds: float) -> int:
        """How many frames ago is closest to ``seconds``; at least 1 unless there is only the current frame."""
        if len(self._frames) < 2:
            return 0
        now_ns = self._frames[0].stamp_ns
        distances = [abs((now_ns - each.stamp_ns) / NANOSECONDS - seconds) for each in self._frames[1:]]
        return distances.index(min(distances)) + 1


def _least_missed(frames: list[RecentFrame]) -> int:
    """Number of the one whose neighbours are closest to each other in time, but for the first two and the last."""
    stamps = [each.stamp_ns for each in frames]
    gaps = [after - before for after, before in zip(stamps[1:-2], stamps[3:], strict=True)]
    return 2 + gaps.index(min(gaps))


def _halved(gray: ByteArray) -> ByteArray:
    height, width = gray.shape
    half: ByteArray = cv2.resize(gray, (-(-width // 2), -(-height // 2)), interpolation=cv2.INTER_AREA)
    return half
