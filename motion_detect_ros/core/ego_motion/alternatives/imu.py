"""Angular rates of an IMU, integrated to the camera's rotation between two images and to the homography it causes.

Conventions: a rate is that of the IMU's frame against the world, about its own axes. The optical frame has x right,
y down, z ahead. ``roll_rad``, ``pitch_rad``, ``yaw_rad`` turn vectors of the IMU's frame into the optical one,
R = Rz(yaw) Ry(pitch) Rx(roll) (REP 103, fixed axes); an IMU with x ahead, y left, z up needs pi/2, -pi/2, 0. A sample
counts for the camera's time stamp + ``time_offset_s``.
"""

from __future__ import annotations

from bisect import bisect_left, bisect_right
from collections import deque
from itertools import pairwise

import numpy as np
from scipy.spatial.transform import Rotation

from motion_detect_ros.core.config import ImuConfig
from motion_detect_ros.core.types import NANOSECONDS, CameraModel, DoubleArray

#: Samples kept at most: 20 s at 1000 Hz.
CAPACITY = 20_000
#: Faster than any gyroscope measures, rad/s; most end at 35 or 70 (2000 or 4000 degrees/s).
MAX_RATE = 1000.0
#: Depth after the rotation of a point that had depth 1, under which it is out of view.
MIN_DEPTH = 0.1


class GyroBuffer:
    """Collects angular rates and integrates them between images that come in order of time."""

    def __init__(self, config: ImuConfig) -> None:
        self._to_optical = Rotation.from_euler('xyz', [config.roll_rad, config.pitch_rad, config.yaw_rad])
        self._offset_ns = round(config.time_offset_s * NANOSECONDS)
        self._max_gap_ns = round(config.max_gap_s * NANOSECONDS)
        self._samples: deque[tuple[int, DoubleArray]] = deque(maxlen=CAPACITY)

    def reset(self) -> None:
        """Clear all samples."""
        self._samples.clear()

    def add(self, stamp_ns: int, rate: DoubleArray) -> None:
        """One sample. stamp_ns: of the IMU's clock; rate: (3,) rad/s in the IMU's frame.

        Samples that are not finite, that no gyroscope measures, or that have the stamp of the last one are ignored; an
        earlier stamp clears the buffer (a new recording).
        """
        measured = np.asarray(rate, np.float64)
        if measured.shape != (3,) or not (np.abs(measured) < MAX_RATE).all():
            return
        stamp_ns += self._offset_ns
        if self._samples and stamp_ns == self._samples[-1][0]:
            return
        if self._samples and stamp_ns < self._samples[-1][0]:
            self._samples.clear()
        self._samples.append((stamp_ns, self._to_optical.apply(measured)))

    def rotation(self, from_ns: int, to_ns: int) -> DoubleArray | None:
        """(3, 3) R that takes directions in the optical frame of time ``from_ns`` to that of ``to_ns``.

        None where the samples leave a gap over ``max_gap_s``. Samples long before ``from_ns`` are removed.
        Rates are linear between samples and constant beyond the last; each piece turns by its mean rate.
        """
        self._forget_before(from_ns - self._max_gap_ns)
        stamps = [stamp for stamp, _ in self._samples]
        if to_ns <= from_ns or not self._covered(stamps, from_ns, to_ns):
            return None
        inside = stamps[bisect_right(stamps, from_ns):bisect_left(stamps, to_ns)]
        times = (np.array([from_ns, *inside, to_ns]) - from_ns) / NANOSECONDS
        known = (np.array(stamps) - from_ns) / NANOSECONDS
        recorded = np.array([rate for _, rate in self._samples])
        rates = np.column_stack([np.interp(times, known, axis) for axis in recorded.T])
        attitude = Rotation.identity()
        for turn in 0.5 * (rates[1:] + rates[:-1]) * np.diff(times)[:, None]:
            attitude *= Rotation.from_rotvec(turn)
        return np.asarray(attitude.as_matrix().T, np.float64)

    def _covered(self, stamps: list[int], from_ns: int, to_ns: int) -> bool:
        """Whether no time between the two is further from its neighbouring samples than ``max_gap_s``."""
        first, last = max(0, bisect_right(stamps, from_ns) - 1), bisect_left(stamps, to_ns)
        used = stamps[first:last + 1]
        if not used or used[0] > from_ns + self._max_gap_ns or used[-1] < to_ns - self._max_gap_ns:
            return False
        return max((b - a for a, b in pairwise(used)), default=0) <= self._max_gap_ns

    def _forget_before(self, stamp_ns: int) -> None:
        while len(self._samples) > 1 and self._samples[1][0] < stamp_ns:
            self._samples.popleft()


def rotation_homography(rotation: DoubleArray, camera: CameraModel) -> DoubleArray | None:
    """(3, 3) K R K^-1, previous pixel -> current pixel (Hartley and Zisserman 2004, section 8.4), at any depth.

    rotation: (3, 3) R as of ``GyroBuffer.rotation``. None where a corner of the image turns out of sight.
    """
    k = camera.matrix
    matrix: DoubleArray = k @ rotation @ np.linalg.inv(k)
    x, y = camera.width - 1.0, camera.height - 1.0
    corners = np.array([[0.0, 0.0, 1.0], [x, 0.0, 1.0], [0.0, y, 1.0], [x, y, 1.0]])
    return matrix / matrix[2, 2] if (corners @ matrix[2]).min() > MIN_DEPTH else None
