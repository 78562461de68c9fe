"""The last frames and the ego-motions between them, and the reference frame among them."""

from __future__ import annotations

from dataclasses import dataclass

from motion_detect_ros.core.geometry.motion_chain import MAX_LINKS, MotionChain
from motion_detect_ros.core.geometry.resizing import like
from motion_detect_ros.core.types import NANOSECONDS, ByteArray, DoubleArray, EgoMotion, PreparedFrame


@dataclass(frozen=True)
class ReferenceFrame:
    """The earlier frame that the current one is compared with.

    ``gray``: (h, w) uint8, working resolution; ``matrix``: (3, 3) reference pixel -> current pixel, full resolution;
    ``seconds``: time between the two.
    """

    gray: ByteArray
    matrix: DoubleArray
    seconds: float


class FrameHistory:
    """Keeps grey images and ego-motions; the reference frame is the one closest to ``baseline_s`` ago.

    The pipeline has one for its stages; separate nodes have one each and derive the same reference frame from the
    same ``ego_motion`` messages.
    """

    def __init__(self, baseline_s: float) -> None:
        self._baseline_s = baseline_s
        self._chain = MotionChain()
        self._frames: dict[int, PreparedFrame] = {}
        self._passed_over: PreparedFrame | None = None

    def reset(self) -> None:
        """Clear all frames."""
        self._chain.reset()
        self._frames.clear()
        self._passed_over = None

    def step(self, frame: PreparedFrame, ego: EgoMotion) -> ReferenceFrame | None:
        """Add a frame and the motion into it, unless it is passed over; returns its reference frame, None = none."""
        if ego.passed_over:
            self._passed_over = frame
            return None
        if self._passed_over is not None and self._passed_over.stamp_ns == ego.prev_stamp_ns:  # after a cut
            self._frames[ego.prev_stamp_ns] = self._passed_over
        self._passed_over = None
        self._chain.append(ego)
        link = self._chain.nearest(self._baseline_s)
        earlier = self._frames.get(link.stamp_ns) if link else None
        self._frames.pop(frame.stamp_ns, None)  # where a clock that went back gives its times again, it is the newest
        self._frames[frame.stamp_ns] = frame
        while len(self._frames) > MAX_LINKS + 1:
            del self._frames[next(iter(self._frames))]
        if link is None or earlier is None or (earlier.width, earlier.height) != (frame.width, frame.height):
            return None
        seconds = (frame.stamp_ns - link.stamp_ns) / NANOSECONDS
        return ReferenceFrame(like(earlier.gray, frame.gray.shape), link.matrix, seconds)
