"""What every format of the detections is given, frame by frame."""

from __future__ import annotations

from dataclasses import dataclass
from types import TracebackType
from typing import Protocol, Self

import numpy as np

from motion_detect_ros.core.types import ByteArray, RecordArray
from motion_detect_ros.results.metrics import boxes_of
from motion_detect_ros.sources.frames import CAMERA_FRAME


@dataclass(frozen=True)
class FrameDetections:
    """What was found in one processed frame.

    ``frame``: number in the source, from 0; ``records``: dtype ``DETECTION_DTYPE``; ``size``: width and height of the
    picture, pixels, (0, 0) where not known; ``image``: (H, W[, 3]) uint8, where pictures are wanted in the results;
    ``frame_id``: of the picture's message, of which the detections are.
    """

    frame: int
    stamp_ns: int
    records: RecordArray
    size: tuple[int, int] = (0, 0)
    image: ByteArray | None = None
    frame_id: str = CAMERA_FRAME


class DetectionWriter(Protocol):
    """A file under construction, used as a context manager: ``.part`` until it is complete."""

    def write(self, found: FrameDetections) -> None:
        """Add one frame, also one in which nothing was found."""

    def __enter__(self) -> Self: ...

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None,
    ) -> None: ...


def finite(records: RecordArray) -> RecordArray:
    """Those whose box and score are finite: the formats of others have no NaN."""
    return records[np.isfinite(boxes_of(records)).all(axis=1) & np.isfinite(records['score'])]
