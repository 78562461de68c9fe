"""Angular rates beside the pictures: which samples a stage gets before which picture, the same live and replayed."""

from __future__ import annotations

import threading
from collections import deque
from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any, Protocol, runtime_checkable

from motion_detect_ros.core.types import NANOSECONDS

#: Samples kept at most; at 1000 Hz these are 20 s.
CAPACITY = 20_000
#: A sample after the picture closes its interval if it is this near; slower IMUs are not waited for, ns.
NEAR_NS = 50_000_000
#: No IMU is as slow: a sample this far after a picture follows a pause, or has a wrong stamp, ns.
FAR_NS = NANOSECONDS
#: A picture this long after the one before may have a wrong stamp; no stage bridges more, ns.
LONGEST_PAUSE_NS = 60 * NANOSECONDS


@dataclass(frozen=True)
class GyroSample:
    """Angular velocity about the axes of the IMU's own frame, rad/s. ``stamp_ns``: of the source, ns."""

    stamp_ns: int
    rate: tuple[float, float, float]


def rates_of(imu: Any) -> tuple[float, float, float] | None:
    """Angular velocity of a sensor_msgs/Imu about the axes of its frame, rad/s.

    None where the message says that it has none: by -1 as the first element of the covariance.
    """
    if imu.angular_velocity_covariance[0] == -1:
        return None
    rate = imu.angular_velocity
    return float(rate.x), float(rate.y), float(rate.z)


@runtime_checkable
class InertialSource(Protocol):
    """A frame source that has angular rates too."""

    def gyro(self) -> Iterator[GyroSample]:
        """The samples in order of time; empty where nothing was recorded."""


class GyroQueue:
    """Samples on their way to a stage. Any thread may add, one takes.

    A picture gets all samples before it and the first one that is not, if that is near: what is needed to integrate up
    to the picture, by the stamps alone, however much earlier or later the samples happen to arrive.
    """

    def __init__(self, time_offset_s: float = 0.0) -> None:
        """time_offset_s: added to the samples' stamps to get the camera's."""
        self._offset_ns = round(time_offset_s * NANOSECONDS)
        self._samples: deque[GyroSample] = deque(maxlen=CAPACITY)
        self._latest_ns: int | None = None
        self._missed_ns: int | None = None
        self._changed = threading.Condition()

    def add(self, sample: GyroSample) -> None:
        """One more sample. Where time jumps back, later samples are forgotten: they are of an earlier run, or their
        stamps were wrong.
        """
        with self._changed:
            while self._samples and sample.stamp_ns < self._samples[-1].stamp_ns:
                self._samples.pop()
            self._samples.append(sample)
            self._latest_ns = sample.stamp_ns
            self._changed.notify_all()

    def covers(self, stamp_ns: int) -> bool:
        """Whether everything up to a picture of ``stamp_ns`` is there."""
        with self._changed:
            return self._covers(stamp_ns)

    def is_far_after(self, stamp_ns: int) -> bool:
        """Whether the latest sample is so long after a picture of ``stamp_ns`` that the next one may be before it."""
        with self._changed:
            return self._covers(stamp_ns + FAR_NS) and len(self._samples) < CAPACITY // 2

    def wait_for(self, stamp_ns: int, timeout_s: float) -> bool:
        """As ``covers``, but gives late samples some time; not before the first sample, nor while none come at all."""
        with self._changed:
            if self._latest_ns is None or self._latest_ns == self._missed_ns:
                return False
            covered = self._changed.wait_for(lambda: self._covers(stamp_ns), timeout_s)
            self._missed_ns = None if covered else self._latest_ns
            return covered

    def take(self, stamp_ns: int) -> list[GyroSample]:
        """The samples for a picture of ``stamp_ns`` that were not taken before, in order of time."""
        taken, end_ns = [], stamp_ns - self._offset_ns
        with self._changed:
            while self._samples and self._samples[0].stamp_ns < end_ns + NEAR_NS:
                taken.append(self._samples.popleft())
                if taken[-1].stamp_ns >= end_ns:
                    break
        return taken

    @property
    def started(self) -> bool:
        """Whether any sample has come."""
        with self._changed:
            return self._latest_ns is not None

    def clear(self) -> None:
        """Forget all samples."""
        with self._changed:
            self._samples.clear()
            self._latest_ns = None

    def _covers(self, stamp_ns: int) -> bool:
        return self._latest_ns is not None and self._latest_ns + self._offset_ns >= stamp_ns


class GyroReplay:
    """Recorded samples, handed over as a live stage gets them. A wrong stamp, of a sample or of a picture, costs that
    one and few after it.
    """

    def __init__(self, samples: Iterator[GyroSample], time_offset_s: float = 0.0) -> None:
        self._coming = samples
        self._queue = GyroQueue(time_offset_s)
        self._picture_ns: int | None = None

    def take(self, stamp_ns: int) -> list[GyroSample]:
        """The samples for a picture of ``stamp_ns``, see ``GyroQueue``; pictures in order of time.

        None for the first picture and one that comes LONGEST_PAUSE_NS after the one before: if its stamp is wrong the
        next pictures need them, if not the next one gets them.
        """
        earlier_ns, self._picture_ns = self._picture_ns, stamp_ns
        if earlier_ns is None or stamp_ns - earlier_ns > LONGEST_PAUSE_NS:
            return []
        self._read_up_to(stamp_ns)
        if self._queue.is_far_after(stamp_ns) and self._read():
            self._read_up_to(stamp_ns)
        return self._queue.take(stamp_ns)

    def _read_up_to(self, stamp_ns: int) -> None:
        while not self._queue.covers(stamp_ns) and self._read():
            pass

    def _read(self) -> bool:
        """Whether there was one more sample."""
        sample = next(self._coming, None)
        if sample is not None:
            self._queue.add(sample)
        return sample is not None
