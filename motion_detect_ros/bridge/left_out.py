"""Images that the first stage left out on purpose, told from those that are missing, in the stages behind it."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from contextlib import suppress
from typing import Any

from motion_detect_ros.bridge.topics import EGO_MOTION
from motion_detect_ros.core.config import LoadConfig
from motion_detect_ros.core.errors import MessageError
from motion_detect_ros.core.frame_decimation import FrameDecimation
from motion_detect_ros.core.load_control import STEPS


class LeftOut:
    """Counts, by the step that comes with each ego-motion, how many images may be without one on purpose.

    It looks at what arrives, not at what the stage works on: a stage that lags is at the step of earlier images.
    """

    def __init__(self) -> None:
        self._step = 0
        self._run = 0  # images without an ego-motion since the latest one
        self._told = 0, 0  # what was said of them already

    def judge(
        self, given_up: Sequence[Mapping[str, Any]], joined: Any | None, load: LoadConfig,
    ) -> tuple[int, int]:
        """How many images were left out on purpose, and how many sets are missing something.

        given_up: sets of messages by the names of their topics, which stay incomplete, in the order of their stamps;
        joined: the ego-motion of the complete set after them, None where there is none.
        """
        told = []
        incomplete = 0
        for items in given_up:
            if EGO_MOTION.name in items:
                told.append(self._end_run(items[EGO_MOTION.name], load))
            if EGO_MOTION.name not in items and 'image' in items:
                self._run += 1
            else:
                incomplete += 1
        told.append(self._tell(load, self._step) if joined is None else self._end_run(joined, load))
        return sum(left_out for left_out, _ in told), incomplete + sum(missing for _, missing in told)

    def _end_run(self, ego: Any, load: LoadConfig) -> tuple[int, int]:
        """As ``_tell``; the step may have changed anywhere before the image of this ego-motion."""
        before = self._step
        with suppress(MessageError):  # it costs its image when that is worked on
            self._step = EGO_MOTION.from_msg(ego).load_step
        told = self._tell(load, before, self._step)
        self._run, self._told = 0, (0, 0)
        return told

    def _tell(self, load: LoadConfig, *steps: int) -> tuple[int, int]:
        """What is new of the run: images left out on purpose, and missing, at least, by one of the steps."""
        missing = max(self._told[1], min(
            FrameDecimation.by(load, STEPS[step].of).kept_at_least(self._run) for step in steps))
        left_out = self._run - missing
        new = left_out - self._told[0], missing - self._told[1]
        self._told = left_out, missing
        return new
