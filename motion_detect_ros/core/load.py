"""How much of the stream is worked on: the first m of every n frames, and how many threads work on them."""

from __future__ import annotations

import cv2

from motion_detect_ros.core.config import LoadConfig


class FrameSelection:
    """Says of each frame in turn whether it is processed: the first ``take`` of every ``of``.

    What is left out is as if it had never been seen; all motion is per second of the stamps, not per frame.
    """

    def __init__(self, config: LoadConfig) -> None:
        self._take, self._of = config.take, config.of
        self._seen = 0

    @property
    def leaves_out(self) -> bool:
        """Whether any frame is left out at all."""
        return self._take < self._of

    def wants(self) -> bool:
        """Whether the next frame is processed; to be asked once for every frame."""
        wanted = self._seen % self._of < self._take
        self._seen += 1
        return wanted

    def reset(self) -> None:
        """Start with a new group."""
        self._seen = 0


def use_threads(config: LoadConfig) -> None:
    """OpenCV's threads for this process; 0 leaves OpenCV's own number.

    The kernels of this package run in one thread each; the flow's way back gets a thread of its own unless OpenCV has
    only one (``OpticalFlowStage``).
    """
    if config.threads:
        cv2.setNumThreads(config.threads)
