"""Counts and times as frames go by, in memory that hardly grows: 24 bytes a frame, and the ids."""

from __future__ import annotations

from array import array
from collections import Counter
from dataclasses import asdict, dataclass, field

from motion_detect_ros.core.self_tuning import Tuned
from motion_detect_ros.core.types import Result
from motion_detect_ros.results.summary import STAGES, Percentiles


def _times() -> array[float]:
    return array('f')


@dataclass
class Tally:
    """What becomes the summary of a replay. Times in ms, float32."""

    frames: int = 0
    bad_frames: int = 0
    bad_reason: str = ''
    misstamped_frames: int = 0
    calibrated: bool = False
    detections: int = 0
    ids: set[int] = field(default_factory=set)
    ego_status: Counter[str] = field(default_factory=Counter)
    times_ms: dict[str, array[float]] = field(default_factory=lambda: {stage: _times() for stage in STAGES})
    decode_ms: array[float] = field(default_factory=_times)
    first_stamp_ns: int = 0
    last_stamp_ns: int = 0
    image_size: tuple[int, int] = (0, 0)
    tuned: dict[str, int | float] = field(default_factory=dict)

    def read(self, decode_ms: float) -> None:
        """Count one frame of the source as read, whatever becomes of it."""
        self.decode_ms.append(decode_ms)

    def add(self, result: Result, tuned: Tuned | None = None) -> None:
        """Count one processed frame; tuned: settings in use after it."""
        self.tuned = asdict(tuned) if tuned else {}
        self.first_stamp_ns = self.first_stamp_ns if self.frames else result.stamp_ns
        self.last_stamp_ns = result.stamp_ns
        self.frames += 1
        self.detections += len(result.detections)
        self.ids.update(result.detections['id'].tolist())
        self.ego_status[result.ego.status.name.lower()] += 1
        for stage, times in self.times_ms.items():
            times.append(getattr(result.times_ms, stage))
        self.image_size = result.flow.width, result.flow.height

    def stage_ms(self) -> dict[str, Percentiles]:
        """Percentiles of every stage."""
        return {stage: Percentiles.of(times) for stage, times in self.times_ms.items()}
