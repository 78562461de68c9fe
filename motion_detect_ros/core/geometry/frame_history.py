"""The last few frames and the motions between them: what the scene looked like some time ago."""

from __future__ import annotations

from dataclasses import dataclass

from motion_detect_ros.core.geometry.motion_chain import MAX_LINKS, MotionChain
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
    """Keeps grey frames and ego-motions; ``baseline_s`` says how far back the reference frame lies.

    The pipeline keeps one for its stages; of separate nodes each keeps its own, and as all derive the same reference
    from the same ``ego_motion`` messages they agree without telling each other.
    """

    def __init__(self, baseline_s: float) -> None:
        self._baseline_s = baseline_s
        self._chain = MotionChain()
        self._frames: dict[int, ByteArray] = {}

    def reset(self) -> None:
        """Forget everything."""
        self._chain.reset()
        self._frames.clear()

    def step(self, frame: PreparedFrame, ego: EgoMotion) -> ReferenceFrame | None:
        """Take in a frame and the motion into it; the frame ``baseline_s`` before, None where it is not known."""
        self._chain.append(ego)
        link = self._chain.nearest(self._baseline_s)
        gray = self._frames.get(link.stamp_ns) if link else None
        self._frames[frame.stamp_ns] = frame.gray
        while len(self._frames) > MAX_LINKS + 1:
            del self._frames[next(iter(self._frames))]
        if link is None or gray is None or gray.shape != frame.gray.shape:
            return None
        return ReferenceFrame(gray, link.matrix, (frame.stamp_ns - link.stamp_ns) / NANOSECONDS)
