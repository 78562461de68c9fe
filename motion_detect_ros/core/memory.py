"""The last few frames and the motions between them: what "some time ago" looked like, for every stage that asks."""

from __future__ import annotations

from dataclasses import dataclass

from motion_detect_ros.core.ego_chain import MAX_LINKS, EgoChain
from motion_detect_ros.core.types import NANOSECONDS, ByteArray, DoubleArray, EgoMotion, PreparedFrame


@dataclass(frozen=True)
class Earlier:
    """An earlier frame as seen from the current one.

    ``gray``: (h, w) uint8, working resolution; ``matrix``: (3, 3) earlier pixel -> current pixel, full resolution;
    ``seconds``: time between the two.
    """

    gray: ByteArray
    matrix: DoubleArray
    seconds: float


class FrameMemory:
    """Keeps grey frames and ego-motions; ``baseline_s`` says how far back to look."""

    def __init__(self, baseline_s: float) -> None:
        self._baseline_s = baseline_s
        self._chain = EgoChain()
        self._frames: dict[int, ByteArray] = {}

    def reset(self) -> None:
        """Forget everything."""
        self._chain.reset()
        self._frames.clear()

    def step(self, frame: PreparedFrame, ego: EgoMotion) -> Earlier | None:
        """Take in a frame and the motion into it; the frame ``baseline_s`` before, None where it is not known."""
        self._chain.append(ego)
        back = self._chain.look_back(self._baseline_s)
        gray = self._frames.get(back.stamp_ns) if back else None
        self._frames[frame.stamp_ns] = frame.gray
        while len(self._frames) > MAX_LINKS + 1:
            del self._frames[next(iter(self._frames))]
        if back is None or gray is None or gray.shape != frame.gray.shape:
            return None
        return Earlier(gray, back.matrix, (frame.stamp_ns - back.stamp_ns) / NANOSECONDS)
